"""A model held against another recording of the bench."""

from dataclasses import replace

import numpy as np
import pytest

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.confirmation import Confirmation, confirm
from forefeel.diagnosis.diagnose import Diagnosed, diagnose
from forefeel.diagnosis.expected_gain import expected_gain, less_own
from forefeel.diagnosis.extended_model import extended_model
from forefeel.diagnosis.sensor_faults import clean
from forefeel.results.confirmation_text import confirmation_lines
from tests.unit.diagnosis_samples import FRICTION_N, made, one_sine
from tests.unit.evaluation_samples import Floats


def strokes(
    seconds: float = 9.0,
    rate_hz: float = 100.0,
    sines: tuple[tuple[float, float], ...] = ((0.5, 4e-3), (1.3, 3e-3), (2.9, 3e-4)),
    friction_n: float = 0.0,
    cubic_n_m3: float = 0.0,
    beat_n: float = 0.0,
) -> Recording:
    """The bench of `diagnosis_samples` along other strokes, with another zero and a force of its own."""
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    x = np.sum([size * np.sin(2 * np.pi * hz * t) for hz, size in sines], axis=0)
    v = np.gradient(x, t)
    force = 0.02 * np.gradient(v, t) + 0.8 * v + 40.0 * x + friction_n * np.tanh(v / 2e-4) + cubic_n_m3 * x**3
    beat = beat_n * np.sin(2 * np.pi * 1.9 * t)
    noise = np.random.default_rng(4).normal(0.0, 2e-3, len(t))
    return Recording("strokes", t, x, np.asarray(force + 0.3 + beat + noise), "strokes.csv")


@pytest.fixture(scope="module")
def rubbing() -> Diagnosed:
    return diagnose(made(friction_n=FRICTION_N))


def on(found: Diagnosed, recording: Recording) -> Confirmation:
    return confirm(found, recording).confirmation


def test_same_bench_in_another_motion_confirms(rubbing: Diagnosed) -> None:
    replay = confirm(rubbing, strokes(friction_n=FRICTION_N))
    c = replay.confirmation
    assert c.verdict == "confirmed"
    assert 0.6 < c.ratio < 1.6
    assert c.gain is not None
    assert 0.7 < c.gain.gain_low < c.gain.gain < c.gain.gain_high < 1.0
    left_n = replay.force_n - replay.extended_n
    assert c.left_n == pytest.approx(np.sqrt(np.mean(left_n**2)))
    assert abs(np.mean(left_n)) < 1e-2 * c.left_n  # the zero of the cell is free


def test_twice_the_friction_does_not_confirm(rubbing: Diagnosed) -> None:
    c = on(rubbing, strokes(friction_n=2.0 * FRICTION_N))
    assert (c.verdict, c.cautions) == ("not_confirmed", ())
    assert c.ratio > 5.0


def test_what_the_first_motion_left_open_is_not_told() -> None:
    """One slow stroke does not tell the mass, and strokes of 8 Hz ask for it."""
    slow = diagnose(one_sine(0.5, 6e-3))
    c = on(slow, strokes(rate_hz=250.0, sines=((8.0, 1e-3), (0.5, 4e-3)), friction_n=0.06))
    assert c.verdict == "not_told"
    assert c.doubt_n > c.left_n > 1.6 * c.expected_n


def test_a_rest_that_is_no_noise_is_a_caution() -> None:
    stiffens = diagnose(strokes(6.0, sines=((0.4, 5e-3), (1.1, 2e-3), (3.1, 4e-4)), cubic_n_m3=1e6))
    quiet, beating = (confirm(stiffens, strokes(cubic_n_m3=1e6, beat_n=beat_n)) for beat_n in (0.0, 2e-3))
    assert (quiet.confirmation.verdict, quiet.confirmation.cautions) == ("confirmed", ())
    assert (beating.confirmation.verdict, beating.confirmation.cautions) == ("confirmed", ("structure",))
    assert [label for label, _ in confirmation_lines(beating)] == ["Confirmed", "", "Caution"]


def test_a_recording_that_asks_little_is_a_caution(rubbing: Diagnosed) -> None:
    """At 100 Hz most of what is left are reversals between two samples."""
    c = on(rubbing, strokes(rate_hz=1000.0, friction_n=FRICTION_N))
    assert c.verdict == "confirmed"
    assert "easier" in c.cautions


def test_phases_of_its_own_run_are_free(rubbing: Diagnosed) -> None:
    regression = rubbing.analysis.regression
    fit = regression.fit({"bias": (), "pulsation": (1.1,), "sensor_drift": ()})
    t = regression.signals.t
    other: Floats = 0.1 * np.sin(2.0 * np.pi * 1.1 * t + 2.0) + 0.02 * t + 0.5
    assert np.std(less_own(regression, fit, other[:, None])) < 1e-3 * np.std(other)
    assert np.std(less_own(regression, regression.fit({"bias": ()}), other[:, None])) > 0.5 * np.std(other)


def test_a_wall_gives_way_at_another_instant_of_another_run() -> None:
    def stiffens(at_s: float, later: float) -> Recording:
        plain = strokes(6.0, sines=((0.7, 5e-3), (1.9, 1e-3 + later)))
        assert plain.force_n is not None
        more = 40.0 * plain.position_m * (plain.time_s >= at_s)
        return replace(plain, time_s=plain.time_s + later, force_n=plain.force_n + more)

    found = diagnose(stiffens(2.5, 0.0))
    assert [cause.name for cause in found.diagnosis.causes if cause.name != "bias"] == ["stiffness_change"]
    for at_s in (-1.0, 3.3, 99.0):
        c = on(found, stiffens(at_s, 1e-3))
        assert c.verdict == "confirmed"
        assert c.ratio < 1.3


def test_what_a_known_limit_has_clipped_does_not_count() -> None:
    """Over half of the other recording, which alone is taken for a force of two levels."""

    def clipped(recording: Recording, deeper_m: float = 0.0) -> Recording:
        force_n = np.minimum(np.asarray(recording.force_n) + 40.0 * deeper_m, 0.5)
        return replace(recording, position_m=recording.position_m + deeper_m, force_n=force_n)

    found = diagnose(clipped(strokes(friction_n=FRICTION_N)))
    assert found.diagnosis.causes[0].name == "sensor_saturation"
    other = clipped(strokes(6.0, sines=((0.7, 4e-3), (2.1, 1e-3)), friction_n=FRICTION_N), 5e-3)
    assert not clean(other).clipped.any()
    assert np.mean(clean(other, found.diagnosis.causes).clipped) > 0.5
    assert on(found, other).ratio < 2.0


def test_a_load_cell_that_only_pushes_has_one_end() -> None:
    """Of 0 to 10 N, say: the model and another recording are clipped on that side alone."""
    free = strokes(friction_n=FRICTION_N)
    force_n = np.asarray(free.force_n) - 0.15
    found = diagnose(replace(free, force_n=np.maximum(force_n, 0.0)))
    causes = {cause.name: cause for cause in found.diagnosis.causes}
    assert list(causes["sensor_saturation"].parameters) == ["lower_n"]
    assert causes["coulomb_friction"].parameters["force_n"].value == pytest.approx(FRICTION_N, rel=0.05)
    clipped = clean(replace(free, force_n=force_n), found.diagnosis.causes).clipped
    assert np.array_equal(clipped, force_n <= 0.0)
    (entry,) = (e for e in extended_model(found.analysis, "bench").effects if e.effect == "sensor_saturation")
    assert entry.instance().values == {"upper_n": 1e4, "lower_n": 0.0}


def test_what_can_not_be_diagnosed_confirms_nothing(rubbing: Diagnosed) -> None:
    with pytest.raises(RecordingError, match="expected at least 3 s"):
        confirm(rubbing, strokes(seconds=1.0))
    with pytest.raises(RecordingError, match=r"strokes\.csv: 40 Hz, expected at least 60"):
        confirm(rubbing, strokes(rate_hz=40.0))


def test_a_rest_at_the_start_tells_nothing_of_other_motions() -> None:
    moved, rest = strokes(30.0, friction_n=FRICTION_N), np.zeros(4000)
    noise = np.random.default_rng(5).normal(0.0, 2e-3, len(rest))
    x, force_n = np.append(rest, moved.position_m), np.append(0.3 + noise, np.asarray(moved.force_n))
    rested = Recording("rested", np.arange(len(x)) / 100.0, x, force_n, "rested.csv")
    regression = conditioned(rested, clean(rested))
    base, fit = (regression.fit({"bias": (), **causes}) for causes in ({}, {"coulomb_friction": ()}))
    expected = expected_gain(regression, base, fit, 2e-3, 1.0)
    assert expected is not None and expected.gain_low > 0.5
