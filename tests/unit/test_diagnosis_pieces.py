"""The pieces of the diagnosis against oracles: filters, noise, faults, variable projection, verdicts."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import nnls
from scipy.signal import lfilter

from forefeel.common.causes.candidate import Form, Mode, Model
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.error_size import Floats
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.identifiability import turns
from forefeel.diagnosis.noise import autoregression
from forefeel.diagnosis.regression import RecordingRegression, solve, solve_passive
from forefeel.diagnosis.search import Periods
from forefeel.diagnosis.sensor_faults import clean, comb_step
from forefeel.diagnosis.signals import Signals
from forefeel.diagnosis.uncertainty import block_numbers, gain

MASS, DAMPING, STIFFNESS = 0.06, 1.1, 31.0
RATE = 500.0


def motion(seed: int, seconds: float = 24.0, rate: float = RATE) -> tuple[Floats, Floats, Floats, Floats]:
    """t, x and its exact derivatives: a dozen sines from 0.1 to 8 Hz, 1 to 20 mm deep."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    w = 2.0 * np.pi * np.geomspace(0.11, 8.0, 12) * rng.uniform(0.95, 1.05, 12)
    phase = np.outer(t, w) + rng.uniform(0.0, 6.28, 12)
    size = 4e-3 / (1.0 + (w / 4.0) ** 1.5)
    return t, 0.012 + np.sin(phase) @ size, np.cos(phase) @ (size * w), -np.sin(phase) @ (size * w * w)


def noise(seed: int, count: int, rms: float = 2e-3, corner_hz: float = 20.0) -> Floats:
    decay = np.exp(-2.0 * np.pi * corner_hz / RATE)
    e = lfilter([1.0], [1.0, -decay], np.random.default_rng(seed).standard_normal(count))
    return np.asarray(e * rms / np.std(e))


def linear(x: Floats, v: Floats, a: Floats) -> Floats:
    return np.asarray(MASS * a + DAMPING * v + STIFFNESS * x)


def recording(t: Floats, x: Floats, f: Floats) -> Recording:
    return Recording("test", t, x, f, "test")


def signals(t: Floats, x: Floats, f: Floats, cutoff_hz: float = 30.0) -> Signals:
    return Signals(recording(t, x, f), f, cutoff_hz, np.zeros(len(t), dtype=np.bool_))


@pytest.mark.parametrize(("uneven", "rel"), [(False, 1e-4), (True, 0.03)])
def test_derivatives_pass_the_filter_of_the_force_at_uneven_stamps_and_with_gaps_too(
    uneven: bool, rel: float
) -> None:
    t, x, v, a = motion(2)
    keep = np.arange(len(t))
    if uneven:
        keep = np.sort(np.random.default_rng(0).choice(len(t), int(0.8 * len(t)), replace=False))
        keep = keep[(t[keep] < 9.0) | (t[keep] > 10.5)]
    s = signals(t[keep], x[keep], linear(x, v, a)[keep])
    assert len(s.pieces) == 1 + uneven
    columns = np.column_stack([s.column(s.linear_spectrum(d)) for d in (2, 1, 0)])[s.rows]
    theta, rss = solve(columns, s.force[s.rows])
    assert theta == pytest.approx([MASS, DAMPING, STIFFNESS], rel=rel)
    assert uneven or np.sqrt(rss / len(columns)) < 1e-4 * np.std(s.force)


def test_lines_of_an_encoder_at_constant_speed_are_no_motion() -> None:
    """Ramps of 1.7 mm/s make 170 steps of 10 um a second; a tremor of .1 mm at 9 Hz is motion."""
    t = np.arange(10_000) / RATE
    ramps = 3e-3 * np.abs(np.mod(t / 3.5, 2.0) - 1.0)
    x = gaussian_filter1d(ramps, 0.05 * RATE, mode="nearest")
    still, shaken = (1e-5 * np.round(1e5 * each) for each in (x, x + 1e-4 * np.sin(2.0 * np.pi * 9.0 * t)))
    assert signals(t, still, x).motion_reach_hz < 9.0
    assert 9.0 < signals(t, shaken, x).motion_reach_hz < 20.0


@pytest.mark.parametrize("encoder_m", [1e-6, 2e-5])
@pytest.mark.parametrize("rate", [20.0, 30.0, 50.0, 100.0])
@pytest.mark.parametrize("last_hz", [3.0, 5.0, 6.0])
def test_chirp_is_followed_to_its_end_and_no_noise_derived(
    rate: float, last_hz: float, encoder_m: float
) -> None:
    """What is left of mass, damper and spring beside 2 mN of noise, and by spectral derivatives alone."""
    rng = np.random.default_rng(int(rate + last_hz))
    fine = np.arange(25_000) / 1e3
    hz = 0.1 * (last_hz / 0.1) ** (fine / 25.0)
    x = 0.0135 / (1.0 + hz) ** 0.9 * np.sin(2e-3 * np.pi * np.cumsum(hz))
    v = np.gradient(x, 1e-3)
    f = linear(x, v, np.gradient(v, 1e-3))
    at = np.round(np.arange(int(25 * rate)) * 1e3 / rate).astype(int)
    t, force = fine[at], f[at] + rng.normal(0.0, 2e-3, len(at))
    position = encoder_m * np.round(x[at] / encoder_m + rng.normal(0.0, 0.3, len(at)))

    s = signals(t, position, force, min(30.0, 0.45 * rate))
    columns = [*(s.column(s.linear_spectrum(d)) for d in (2, 1, 0)), np.ones_like(s.t)]
    _, rss = solve(np.column_stack(columns)[s.rows], s.force[s.rows])
    w, spectrum = 2j * np.pi * np.fft.rfftfreq(len(t), 1.0 / rate), np.fft.rfft(position)
    plain = [*(np.fft.irfft(w**d * spectrum, len(t)) for d in (2, 1, 0)), np.ones_like(t)]
    _, plain_rss = solve(np.column_stack(plain)[20:-20], force[20:-20])
    assert rss / np.count_nonzero(s.rows) < 1.1**2 * plain_rss / (len(t) - 40)


def test_whitened_noise_is_white_and_its_size_is_known() -> None:
    rng = np.random.default_rng(3)
    e = 0.5 * rng.standard_normal(20_000)
    coloured = lfilter([1.0], [1.0, -0.8], e)
    rows, pieces = np.ones(len(e), dtype=np.bool_), [slice(0, 9_000), slice(9_000, 20_000)]
    rows[4_000:4_300] = False
    found = autoregression(np.where(rows, coloured, 1e3), rows, pieces, 200.0)
    assert found.innovation_n == pytest.approx(0.5, rel=0.03)
    assert found.taps[1] == pytest.approx(-0.8, abs=0.03)
    white = found.whiten(np.where(rows, coloured, 1e3)[:, None], pieces)[found.rows(rows, pieces)][:, 0]
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.03
    assert np.std(white) == pytest.approx(0.5, rel=0.03)


def test_dependent_columns_do_not_break_the_fit() -> None:
    rng = np.random.default_rng(4)
    a = rng.standard_normal((200, 2))
    theta, rss = solve(np.column_stack([a, a[:, 0] * 3.0]), a @ [1.0, 2.0])
    assert rss < 1e-18
    assert (theta[0] + 3.0 * theta[2], theta[1]) == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize("model", [{}, {"bias": (), "stiffening": ()}, {"time_delay": (0.02,)}])
def test_no_fit_scores_lower_than_its_bound_and_one_of_right_signs_as_low(model: Model) -> None:
    t, x, v, a = motion(5)
    f = linear(x, v, a) + 0.02 * np.tanh(200.0 * v) + noise(5, len(t))
    regression = RecordingRegression(signals(t, x, f), 1e-3)
    nearest = []
    for name, candidate in CANDIDATES.items():
        if not isinstance(candidate, Form | Mode) or name in model:
            continue
        shapes = candidate.grid(regression.extent)[:20]
        bounds = regression.lowest_scores(model, {name: shapes})[name]
        for shape, bound in zip(shapes, bounds, strict=True):
            above = regression.fit({**model, name: shape}).score - bound
            assert above > 0.0, (name, shape)
            nearest.append(above)
    assert np.sum(np.array(nearest) < 1.01) > 50


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_passive_least_squares_of_columns_that_are_nearly_one(sense: float) -> None:
    """As Lawson and Hanson's, where two of the columns differ by a thousandth."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        table = rng.standard_normal((50, 3))
        table[:, 1] = -table[:, 0] + 1e-3 * table[:, 1]
        target = rng.standard_normal(50)
        found, _ = solve_passive(table.T @ table, table.T @ target, sense, 3)
        assert table @ found == pytest.approx(sense * table @ nnls(table, sense * target)[0], abs=1e-6)


def test_the_bootstrap_over_blocks_covers_a_known_gain() -> None:
    """Two predictors of one strongly coloured series, errors 1 and 0.8: 95 % intervals hold the true gain."""
    t, x, v, a = motion(7, seconds=40.0)
    regression = RecordingRegression(signals(t, x, linear(x, v, a)), 1e-5)
    count, covered = int(np.count_nonzero(regression.rows)), 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        slow = lfilter([1.0], [1.0, -0.95], rng.standard_normal((2, count + 200)), axis=1)[:, 200:]
        found = gain(regression, slow[0], 0.8 * slow[1])
        covered += found.gain_low <= 0.2 <= found.gain_high
    assert covered >= 85
    assert len(np.unique(block_numbers(regression))) == 16


def test_a_comb_is_found_and_decimals_are_none() -> None:
    t, x, v, a = motion(8)
    f = linear(x, v, a) + noise(8, len(t))
    assert comb_step(np.round(f / 0.037) * 0.037) == pytest.approx(0.037, rel=1e-6)
    assert comb_step(f) is None
    fine = [fault.name for fault in diagnose(recording(t, x, np.round(f, 4))).diagnosis.causes]
    assert fine == []


def test_spikes_are_counted_by_the_time_without_gaps() -> None:
    t, x, v, a = motion(13)
    force = linear(x, v, a) + noise(13, len(t))
    force[250::500] += 1.0
    (fault,) = clean(recording(np.where(t < 12.0, t, t + 3600.0), x, force)).faults
    assert fault.parameters["rate_hz"].value == pytest.approx(1.0, rel=0.05)


def test_hum_is_found_off_its_nominal_frequency_and_a_tremor_is_not() -> None:
    t, x, v, a = motion(11)
    f = linear(x, v, a) + noise(11, len(t))
    cleaned = clean(recording(t, x, f + 0.02 * np.sin(2.0 * np.pi * 49.93 * t + 0.4)))
    (fault,) = cleaned.faults
    assert fault.name == "mains_hum"
    assert fault.parameters["frequency_hz"].value == pytest.approx(49.93, abs=0.005)
    assert fault.parameters["amplitude_n"].value == pytest.approx(0.02, rel=0.03)
    assert np.std(cleaned.force_n - f) < 2e-3


def test_a_tremor_that_would_alias_to_the_mains_does_not_hide_the_hum() -> None:
    t = np.arange(int(20.0 * RATE)) / RATE
    tremor = 1e-4 * np.sin(2.0 * np.pi * 8.6 * t)  # 50 Hz less the 41.7 Hz at which a line is looked for
    x = 0.01 * np.sin(2.0 * np.pi * 0.4 * t) + tremor + noise(20, len(t), rms=1e-7, corner_hz=200.0)
    force = 25.0 * x + 0.006 * np.sin(2.0 * np.pi * 50.0 * t) + noise(21, len(t))
    assert [fault.name for fault in clean(recording(t, x, force)).faults] == ["mains_hum"]


def test_hum_is_found_behind_a_stray_first_stamp() -> None:
    t, x, v, a = motion(11)
    force = linear(x, v, a) + noise(11, len(t)) + 0.02 * np.sin(2.0 * np.pi * 49.93 * t)
    stamps_s = np.append(0.0, 300.0 + t[1:])
    (fault,) = clean(recording(stamps_s, x, force)).faults
    assert fault.parameters["frequency_hz"].value == pytest.approx(49.93, abs=0.005)


def test_a_jump_of_the_time_by_months_does_not_end_the_search() -> None:
    t, x, v, a = motion(12)
    stamps_s = np.where(t < 12.0, t, t + 1e7)
    force = linear(x, v, a) + 0.3 * np.sign(v) + noise(12, len(t))
    causes = diagnose(recording(stamps_s, x, force)).diagnosis.causes
    assert [cause.name for cause in causes] == ["coulomb_friction"]


def test_a_stiffness_changes_about_the_position_where_its_spring_is_relaxed() -> None:
    t, x, v, a = motion(21)
    rest_m = 0.006
    f = linear(x - rest_m, v, a) + np.where(t > 11.0, 0.8 * STIFFNESS * (x - rest_m), 0.0)
    found = diagnose(recording(t, x, np.asarray(f + noise(21, len(t))))).diagnosis
    assert [cause.name for cause in found.causes] == ["stiffness_change", "bias"]
    parameters = found.causes[0].parameters
    assert parameters["time_s"].value == pytest.approx(11.0, abs=0.05)
    assert parameters["ratio"].value == pytest.approx(1.8, rel=0.03)
    assert parameters["rest_position_m"].value == pytest.approx(rest_m, rel=0.05)


def test_turns_are_counted_by_their_size() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    assert turns(np.sin(2.0 * np.pi * t)) == 20
    assert turns(t + 0.05 * np.sin(20.0 * t)) == turns(np.empty(0)) == 0


def test_one_frequency_tells_dry_friction_and_no_delay() -> None:
    """Friction has harmonics that nothing else gives; a late force is one more damper."""
    t = np.arange(int(20.0 * RATE)) / RATE
    w = 2.0 * np.pi * 1.3
    x, v, a = 0.01 * np.sin(w * t), 0.01 * w * np.cos(w * t), -0.01 * w * w * np.sin(w * t)
    rubbing = linear(x, v, a) + 0.06 * np.tanh(v / 1e-4) + noise(13, len(t))
    late = np.interp(t - 0.02, t, linear(x, v, a)) + noise(13, len(t))
    named, unnamed = (diagnose(recording(t, x, f)).diagnosis for f in (rubbing, late))
    assert [cause.name for cause in named.causes] == ["coulomb_friction"]
    assert unnamed.causes == ()


@pytest.mark.parametrize(
    ("still", "flat", "says"), [(True, False, "motion"), (False, True, "force never changes")]
)
def test_without_motion_or_force_nothing_is_diagnosed(still: bool, flat: bool, says: str) -> None:
    t, x, v, a = motion(17, seconds=9.0)
    f = linear(x, v, a)
    with pytest.raises(RecordingError, match=says):
        diagnose(recording(t, 0.0 * x if still else x, 0.0 * f + 1.0 if flat else f))


def test_a_force_of_glitches_alone_never_changes() -> None:
    t, x, *_ = motion(17, seconds=9.0)
    f = np.full(len(t), 0.7)
    f[np.random.default_rng(1).choice(len(t), 60, replace=False)] += np.linspace(2.0, 4.0, 60)
    with pytest.raises(RecordingError, match="force never changes"):
        diagnose(recording(t, x, f))


def test_noise_is_learned_between_holes() -> None:
    """A colour of twelve taps would leave no row between holes that are nine samples apart."""
    rng, rows = np.random.default_rng(1), np.ones(900, dtype=np.bool_)
    rows[::10] = False
    noise = autoregression(rng.standard_normal(900), rows, [slice(0, 900)], 100.0)
    assert 2 * np.count_nonzero(noise.rows(rows, [slice(0, 900)])) >= np.count_nonzero(rows)


@pytest.mark.parametrize("scale", [1e-9, 1e10])
def test_waves_beyond_the_bounds_of_their_period_end_no_search(scale: float) -> None:
    t, x, v, a = motion(19, seconds=9.0)
    far = recording(t, scale * x, linear(x, v, a))
    regression = conditioned(far, clean(far))
    assert len(Periods(regression).over_position(regression.fit({}))) == 4
