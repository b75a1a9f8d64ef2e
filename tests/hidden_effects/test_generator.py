"""What is drawn: shares, noise, motions, the same again, and nothing of the product."""

import subprocess
import sys
from math import exp, pi

import numpy as np
import pytest

from tests.hidden_effects.cases import full, quick
from tests.hidden_effects.generator import OUTSIDE_NAMES, VOCABULARY, draw, drawn_pairs
from tests.hidden_effects.generator.bounds import relative_bounds
from tests.hidden_effects.generator.draw import CONTRADICTIONS, FORMS
from tests.hidden_effects.generator.leftover import columns, leftovers_n, silent
from tests.hidden_effects.generator.motion import MOTIONS, RICH, drawn_motion
from tests.hidden_effects.generator.noise import whitened
from tests.hidden_effects.generator.rivals import inseparable
from tests.hidden_effects.generator.scan import Array, smoothed
from tests.hidden_effects.generator.truth import Noise

_SHORT = {"longest_s": 14.0, "fastest_hz": 300.0}


def test_every_name_of_the_vocabulary() -> None:
    assert set(VOCABULARY) == {
        "bias", "coulomb_friction", "stribeck_friction", "presliding_hysteresis", "backlash", "stiffening",
        "hunt_crossley_damping", "quadratic_drag", "asymmetric_damping", "stress_relaxation", "contact_loss",
        "position_dependent_friction", "stiffness_change", "time_delay", "sensor_lag", "sensor_drift",
        "sensor_saturation", "sensor_quantisation", "sensor_spikes", "pulsation", "mains_hum",
        "unmodelled_resonance",
    }  # fmt: skip
    assert len(OUTSIDE_NAMES) >= 12


@pytest.mark.parametrize("size", [0.25])
@pytest.mark.parametrize("name", [*VOCABULARY, *OUTSIDE_NAMES])
def test_share_is_in_its_range_and_leaves_something(name: str, size: float) -> None:
    hidden = draw(name, 1, size, **_SHORT)
    (part,) = hidden.truth.parts
    low, high = (size * bound for bound in part.form.shares)
    if not part.form.own_size:
        assert 0.98 * low <= hidden.truth.shares[0] <= 1.02 * high
    assert leftovers_n(hidden)[0] > 0.0


@pytest.mark.parametrize("name", VOCABULARY)
def test_share_is_what_the_recording_shows(name: str) -> None:
    """The reading with the effect less the reading without, both free of noise."""
    hidden = draw(name, 2, **_SHORT)
    base = silent(hidden, ())
    added = silent(hidden) - base
    spread = float(np.std(added)) if name != "bias" else float(np.sqrt(np.mean(added**2)))
    tolerance = 0.35 if name == "sensor_spikes" else 0.05
    assert spread / float(np.std(base)) == pytest.approx(hidden.truth.shares[0], rel=tolerance)


@pytest.mark.parametrize("name", ["time_delay", "sensor_lag"])
def test_lateness_is_drawn_in_seconds(name: str) -> None:
    (value,) = draw(name, 3, **_SHORT).truth.parameters[name].values()
    (quarter,) = draw(name, 3, 0.25, **_SHORT).truth.parameters[name].values()
    assert 0.02 <= value <= 0.08
    assert quarter == pytest.approx(0.25 * value)


@pytest.mark.parametrize("size", [1.0, 0.25])
def test_a_play_is_wider_than_the_encoder_sees(size: float) -> None:
    widths = [draw("backlash", seed, size, **_SHORT).truth.parameters["backlash"] for seed in range(12)]
    assert min(width["width_m"] for width in widths) > 20e-6


def test_the_same_again_and_something_else() -> None:
    first, again, other = (draw("backlash+bias", seed, **_SHORT) for seed in (4, 4, 5))
    assert np.array_equal(first.force_n, again.force_n)
    assert np.array_equal(first.time_s, again.time_s)
    assert not np.array_equal(first.force_n[:100], other.force_n[:100])
    assert first.truth.names == ("backlash", "bias")


def test_unknown_kind() -> None:
    with pytest.raises(KeyError, match="no kind 'gravity'"):
        draw("gravity", 1)


def test_pairs_are_different_and_without_contradictions() -> None:
    pairs = drawn_pairs(7, 80)
    assert len(set(pairs)) == 80
    assert not {frozenset(pair.split("+")) for pair in pairs} & set(CONTRADICTIONS)


def test_numbers_of_cases() -> None:
    assert len(full()) == 400
    assert len(quick()) == 25
    assert {case.kind for case in full() if case.group == "single"} == set(VOCABULARY)
    assert len({(case.kind, case.seed) for case in full()}) == 400


def test_noise_has_the_stated_size_and_corner() -> None:
    hidden = draw("nothing", 11)
    noise = hidden.force_n - silent(hidden)
    truth = hidden.truth.noise
    assert np.std(noise) == pytest.approx(np.hypot(truth.rms_n, truth.white_n), rel=0.1)
    interval_s = float(np.median(np.diff(hidden.time_s)))
    neighbours = float(np.corrcoef(noise[1:], noise[:-1])[0, 1])
    share = truth.rms_n**2 / (truth.rms_n**2 + truth.white_n**2)
    assert neighbours == pytest.approx(share * exp(-2.0 * pi * truth.corner_hz * interval_s), abs=0.05)


def test_stamps_rates_and_encoder() -> None:
    drawn = [draw("nothing", seed, longest_s=12.0).truth for seed in range(60)]
    assert all(50.0 <= truth.rate_hz <= 2000.0 for truth in drawn)
    assert np.mean([200.0 <= truth.rate_hz <= 1000.0 for truth in drawn]) > 0.6
    assert 0.05 < np.mean([not truth.uniform for truth in drawn]) < 0.4
    assert np.mean([truth.motion == "hand" for truth in drawn]) >= 0.5
    hidden = draw("nothing", 1)
    steps = hidden.position_m / 1e-6
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert np.all(np.diff(hidden.time_s) > 0.0)


@pytest.mark.parametrize("kind", sorted(MOTIONS))
def test_velocity_and_acceleration_are_the_derivatives(kind: str) -> None:
    motion = drawn_motion(np.random.default_rng(3), kind, 10.0, inserted=True)
    inner = slice(20, -20)
    for whole, rate in ((motion.x, motion.v), (motion.v, motion.a)):
        error = np.gradient(whole, motion.t)[inner] - rate[inner]
        assert np.sqrt(np.mean(error**2)) <= 2e-3 * max(float(np.std(rate)), 1e-6)
    assert np.min(motion.x) >= 0.0


def test_a_hand_reverses_rests_and_trembles() -> None:
    motions = [drawn_motion(np.random.default_rng(seed), "hand", 20.0, inserted=False) for seed in range(12)]
    for motion in motions:
        slow = smoothed(0.999, 0.001 * motion.v)
        assert np.count_nonzero(np.diff(np.sign(slow))) >= 4
        assert np.ptp(motion.x) > 4e-3
    trembling = [_share_of_band(motion.a, 6.0, 12.0) > 0.1 for motion in motions]
    assert np.mean(trembling) > 0.5
    assert not all(trembling)


def _share_of_band(values: Array, low_hz: float, high_hz: float) -> float:
    power = np.abs(np.fft.rfft(values)) ** 2
    frequency = np.fft.rfftfreq(len(values), 1e-4)
    return float(np.sum(power[(frequency >= low_hz) & (frequency <= high_hz)]) / np.sum(power))


def test_whitening_leaves_white_noise_of_unit_size() -> None:
    rng = np.random.default_rng(1)
    pole = exp(-2.0 * pi * 20.0 / 500.0)
    noise = smoothed(pole, rng.standard_normal(200_000)) * 2e-3 * np.sqrt(1.0 - pole * pole)
    noise += 5e-4 * rng.standard_normal(len(noise))
    white = whitened(noise, Noise(2e-3, 20.0, 5e-4, 1e-6), 500.0)[100:]
    assert np.std(white) == pytest.approx(1.0, rel=0.01)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.01


def test_the_bound_is_the_spread_of_the_best_estimator() -> None:
    """Generalised least squares over drawn noise; the bound of a linear parameter is its exact spread."""
    hidden = draw("quadratic_drag", 6, **_SHORT)
    truth, rng = hidden.truth, np.random.default_rng(2)
    v = columns(hidden)[:, 1]
    phi = np.column_stack((v * np.abs(v), columns(hidden)))
    white = whitened(phi, truth.noise, truth.rate_hz)
    found = np.linalg.lstsq(white, rng.standard_normal((len(white), 600)), rcond=None)[0][0]
    value = truth.parameters["quadratic_drag"]["drag_n_s2_m2"]
    assert relative_bounds(hidden)["quadratic_drag"]["drag_n_s2_m2"] == pytest.approx(
        np.std(found) / value, rel=0.1
    )


def test_rich_motions_separate_full_sizes() -> None:
    for name in ("coulomb_friction", "bias", "quadratic_drag", "stress_relaxation"):
        hidden = draw(name, 8, **_SHORT)
        assert hidden.truth.motion in RICH
        assert inseparable(hidden) == ()


def test_a_tiny_delay_is_not_told_from_a_lag() -> None:
    assert "sensor_lag" in inseparable(draw("time_delay", 9, 0.02, **_SHORT))


def test_imports_nothing_but_numpy() -> None:
    code = (
        "import sys; import tests.hidden_effects.generator.bounds, tests.hidden_effects.generator.rivals;"
        "print(*{name.partition('.')[0] for name in sys.modules} - set(sys.stdlib_module_names))"
    )
    listed = subprocess.run(
        [sys.executable, "-S", "-c", _WITH_PATH + code], capture_output=True, text=True, check=True
    )
    found = {name for name in listed.stdout.split() if "cython" not in name and "main__" not in name}
    assert found == {"numpy", "tests"}


_WITH_PATH = f"import sys; sys.path[:0] = {sys.path!r}; "


def test_forms_name_their_parameters_as_they_draw_them() -> None:
    assert {form.name for form in FORMS} == set(VOCABULARY)
    for name in VOCABULARY:
        for part in draw(name, 12, **_SHORT).truth.parts:
            assert set(part.form.judged) <= set(part.values)
