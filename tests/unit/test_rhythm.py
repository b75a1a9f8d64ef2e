"""A heart or breath whose rate or size varies: its equation, its course in a diagnosis, and what is named."""

from math import pi, sin

import numpy as np
import pytest

from forefeel.common.causes.candidate import Fitted
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.causes.motion import Motion, MotionGrid, MotionSample
from forefeel.common.causes.periodic import Rhythm, VaryingPulsation, turns
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.sensor_faults import clean
from tests.hidden_effects.guidewire import draw

_COURSE = (1.1, 1.25, 1.3, 1.2, 1.0, 1.15, 1.2, 1.25)


def _recorded(heart: VaryingPulsation | None = None) -> Recording:
    """Strokes of 24 s at 50 Hz against a spring and damper, with 2 mN of noise."""
    t = np.arange(1200) / 50.0
    x = 6e-3 * np.sin(2 * pi * 0.31 * t) + 2e-3 * np.sin(2 * pi * 0.47 * t + 1.0) + 9e-3
    v = np.gradient(x, t)
    force = 40.0 * x + 0.8 * v + np.random.default_rng(3).normal(0.0, 2e-3, len(t))
    if heart is not None:
        force = force + heart.columns(Motion.of(t, x, v, v)) @ np.array(heart.linear_values)
    return Recording("made", t, x, force, source="made.csv")


def _rhythm(form: str = "") -> tuple[Rhythm, MotionGrid]:
    recording, rhythm = _recorded(), CANDIDATES[f"varying_pulsation{form}"]
    assert isinstance(rhythm, Rhythm)
    return rhythm, conditioned(recording, clean(recording)).motion({})


def test_its_force_is_its_closed_form() -> None:
    heart = VaryingPulsation(
        amplitude_n=0.02, amplitude_per_length_n_m=3.0, friction_n=0.1, damping_n_s_m=0.5, zero_m=0.01,
        frequency_hz=1.2, phase_rad=0.4, second_harmonic_ratio=0.3, rate_variation=0.1, variation_hz=0.25,
        variation_phase_rad=1.0,
    )  # fmt: skip
    phi = heart.regressors(MotionSample(7.3, 0.03, -0.02, 0.0, 1e-3))
    p = 2 * pi * 1.2 * (7.3 + 0.1 / (2 * pi * 0.25) * sin(2 * pi * 0.25 * 7.3 + 1.0)) + 0.4
    size = 0.02 + 3.0 * 0.02 - 0.1 - 0.5 * 0.02
    assert np.dot(heart.linear_values, phi) == pytest.approx(size * (sin(p) + 0.3 * sin(2 * p)))


def test_a_course_goes_straight_from_rate_to_rate() -> None:
    t = np.arange(-1.0, 20.0, 1e-3)
    rates = np.gradient(turns(t, _COURSE), t)
    assert np.allclose(rates, np.interp(t, 2.0 * np.arange(8), _COURSE), atol=2e-4)
    assert np.allclose(turns(t, (1.3,)), 1.3 * t)


@pytest.mark.parametrize("form", ["", ":depth", ":friction", ":speed"])
def test_slopes_are_those_of_the_force(form: str) -> None:
    rhythm, motion = _rhythm(form)
    coefficients = np.random.default_rng(1).normal(size=len(rhythm.signs))
    slopes = rhythm.slopes(motion, _COURSE, coefficients)
    for i in (0, 3, 7):
        sides = [tuple(np.array(_COURSE) + side * 1e-5 * (np.arange(8) == i)) for side in (1, -1)]
        up, down = (coefficients @ np.array(rhythm.columns(motion, side)) for side in sides)
        assert np.allclose(slopes[i], (up - down) / 2e-5, atol=0.01 * np.abs(slopes[i]).max())


def test_its_entry_has_the_swing_of_its_course() -> None:
    true = VaryingPulsation(amplitude_n=0.03, frequency_hz=1.2, rate_variation=0.08, variation_hz=0.125)
    t = np.arange(0.0, 32.0, 0.02)
    at_s = 2.0 * np.arange(16)
    course = tuple((1.2 * (1.0 + 0.08 * np.cos(2 * pi * 0.125 * at_s))).tolist())
    wave, form = true.regressors(Motion.of(t, t, t, t))[0], CANDIDATES["varying_pulsation"]
    columns = np.array(form.columns(Motion.of(t, t, t, t), course)).T  # type: ignore[attr-defined]
    coefficients = 0.03 * np.linalg.lstsq(columns, wave, rcond=None)[0]
    (made,) = form.entries(Fitted(coefficients, course, np.ones(3), 0.0))
    again = VaryingPulsation(**made["parameters"])
    left = 0.03 * wave - again.columns(Motion.of(t, t, t, t)) @ np.array(again.linear_values)
    assert np.std(left) < 0.2 * 0.03 * np.std(wave)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("varying_pulsation", {"amplitude_n": 0.05, "variation_hz": 0.09}),
        ("pulsation", {"amplitude_n": 0.05, "rate_variation": 0.0}),
        ("varying_pulsation", {"amplitude_per_length_n_m": 5.0, "zero_m": 3e-3, "rate_variation": 0.0}),
    ],
    ids=["rate", "steady", "depth"],
)
def test_a_heart_is_named_by_what_varies(name: str, values: dict[str, float]) -> None:
    heart = VaryingPulsation(frequency_hz=1.13, second_harmonic_ratio=0.4, phase_rad=0.7, **values)
    diagnosis = diagnose(_recorded(heart)).diagnosis
    assert diagnosis.verdict in ("cause_found", "partly_explained")
    (cause,) = (cause for cause in diagnosis.causes if cause.name != "bias")
    assert cause.name == name and diagnosis.held_out.gain > 0.8
    assert cause.parameters["frequency_hz"].value == pytest.approx(1.13, rel=0.01)
    parameter = next(iter(values))
    assert cause.parameters[parameter].value == pytest.approx(values[parameter], rel=0.1)


@pytest.mark.soak
def test_what_follows_the_motion_has_no_heart() -> None:
    """A friction that wanders, to whose strokes a phase of their own is found all the same."""
    recorded = draw("outside", 1000)
    recording = Recording("made", recorded.time_s, recorded.position, recorded.force, source="made.csv")
    assert "varying_pulsation" not in diagnose(recording).diagnosis.suspected


def test_what_is_quicker_or_less_even_than_a_heart_is_no_rhythm() -> None:
    rhythm, motion = _rhythm()
    courses = (_COURSE, (4.5, 4.4, 4.6), (0.5, 1.5, 0.4))
    assert [rhythm.happens(motion, rates) for rates in courses] == [True, False, False]
