"""Verdicts that say less than a name, and causes that benches have."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from forefeel.common.causes.motion import Motion
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, analyse, conditioned
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.diagnosis.identifiability import EXCITATION
from forefeel.diagnosis.search import Search
from forefeel.diagnosis.sensor_faults import clean
from tests.unit.model_samples import effect, model

RATE_HZ, SECONDS = 250.0, 12.0
FINE_HZ = 500.0  # where an instant or a jump decides


def motion(rate_hz: float = RATE_HZ) -> tuple[Floats, Floats, Floats, Floats]:
    t = np.arange(int(SECONDS * rate_hz)) / rate_hz
    w = 2.0 * np.pi * np.array([0.23, 0.71, 1.9, 4.3])
    size, phase = np.array([9e-3, 4e-3, 1e-3, 2e-4]), np.outer(t, w) + np.arange(4.0)
    x, v, a = np.sin(phase) @ size, np.cos(phase) @ (size * w), -np.sin(phase) @ (size * w * w)
    return t, x + 0.015, v, a


def noisy(t: Floats, x: Floats, force: Floats) -> Recording:
    """With 2 mN of white noise."""
    noise = 2e-3 * np.random.default_rng(5).standard_normal(len(t))
    return Recording("made", t, x, force + noise, "test")


def recorded(*effects: dict[str, object], rate_hz: float = RATE_HZ) -> Recording:
    t, x, v, a = motion(rate_hz)
    return noisy(t, x, model(*effects).runtime().forces_n(Motion.of(t, x, v, a)))


def body(
    mass_kg: float = 0.3, damping_n_s_m: float = 0.9, stiffness_n_m: float = 25.0, site: str = "wall"
) -> dict[str, object]:
    values = {"mass_kg": mass_kg, "damping_n_s_m": damping_n_s_m, "stiffness_n_m": stiffness_n_m}
    return effect("mass_damper_spring", site, **values)


class Hidden(NamedTuple):
    """A cause, what else acts, and how near its numbers and the force of its model come."""

    name: str
    parameters: dict[str, float]
    others: tuple[dict[str, object], ...] = (body(),)
    rel: float = 0.03
    abs: float = 0.0
    left_n: float = 6e-3
    rate_hz: float = RATE_HZ
    found: str = ""  # by another name


STAGE, SLIDES = body(0.3, 0.0, 0.0, "sensor"), body(0.05, 0.9, 0.0, "shaft")
ROOM = effect("pulsation", "sensor", amplitude_n=0.03, frequency_hz=0.1)
PRELOAD, ZERO = effect("bias", "wall", force_n=-0.4), effect("bias", force_n=0.1)
YIELDING = {"yield_n": 0.5, "stiffness_n_m": 40.0, "contact_position_m": 0.004}
TIP = {"stiffness_n_m": 25.0, "limit_n": 0.5, "again_n": 0.2, "kept": 0.3}
PATH = {"force_per_length_n_m": 5.0, "force_n": 0.04, "breakaway_m": 5e-4}
SMOOTH = {"force_n": 0.15, "transition_speed_m_s": 1e-3}
LATE = {"time_constant_s": 0.15}
HIDDEN = {
    "play on the stage": Hidden("play", {"width_m": 8e-4}, (STAGE, body(0.0)), left_n=4e-3),
    "play behind the mass": Hidden("backlash", {"width_m": 8e-4}, left_n=4e-3),
    "wall that yields": Hidden("yielding_wall", YIELDING, (SLIDES,), abs=6e-4, rate_hz=FINE_HZ),
    "wall": Hidden("contact_loss", {"contact_position_m": 0.01}, (SLIDES, body(0.0, 0.0, 40.0)), abs=6e-4),
    "tip that lets go": Hidden("prolapse", TIP, (body(0.05),), abs=6e-4),
    "drift": Hidden("sensor_drift", {"rate_n_s": 0.2, "settling_s": 1.5}, (body(), ROOM), abs=6e-4),
    "bent shaft whose tip pulls and pushes": Hidden(
        "capstan", {"wrap_rad": 0.3}, (body(0.0), PRELOAD, ZERO), left_n=4e-3
    ),
    # tanh(v / v_t) in place of the sign, as of lubricated friction and of most simulators
    "friction over a speed": Hidden("coulomb_friction", SMOOTH, rel=0.1, rate_hz=100.0),
    # of a guidewire in a vessel: 40 mN at the entry, 5 N/m of depth, over .5 mm after each reversal
    "friction along a path": Hidden("position_dependent_friction", PATH, rel=0.1, rate_hz=100.0),
    "late reading": Hidden("sensor_lag", LATE, (body(0.0),), rel=0.05),
    # the reading is that of a spring and a Maxwell branch of 9 / .15 - 25 N/m, too
    "reading late behind 9 N s/m": Hidden(
        "sensor_lag", LATE, (body(0.0, 9.0),), rel=0.05, found="stress_relaxation"
    ),
}


@pytest.mark.parametrize("hidden", HIDDEN.values(), ids=HIDDEN)
def test_cause_is_named_with_its_numbers_and_its_model_gives_the_force(hidden: Hidden) -> None:
    recording = recorded(*hidden.others, effect(hidden.name, **hidden.parameters), rate_hz=hidden.rate_hz)
    found = diagnose(recording)
    (cause,) = (each for each in found.diagnosis.causes if each.name != "bias")
    assert cause.name == (hidden.found or hidden.name)
    fitted = {key: cause.parameters[key].value for key in hidden.parameters}
    assert fitted == pytest.approx(hidden.parameters, rel=hidden.rel, abs=hidden.abs)
    made = extended_model(found.analysis, "made").runtime().forces_n(Motion.of(*motion(hidden.rate_hz)))
    assert recording.force_n is not None
    assert np.sqrt(np.mean((made - recording.force_n)[200:-200] ** 2)) < hidden.left_n


def test_an_instrument_that_is_loose_in_its_play_lies_where_the_tissue_presses_it() -> None:
    loose = effect("play", width_m=8e-4, rest_position_m=0.015, settling_s=0.04)
    (cause,) = diagnose(recorded(STAGE, body(0.0), loose)).diagnosis.causes
    assert cause.name == "play"
    assert cause.parameters["width_m"].value == pytest.approx(8e-4, rel=0.05)
    assert cause.parameters["rest_position_m"].value == pytest.approx(0.015, abs=1e-4)


@pytest.mark.parametrize(
    ("form", "shape", "parameters"),
    [
        ("gripper_slip", (0.45, 1e-3), {"holding_n": 0.45, "slipped_m": 1e-3}),
        ("gripper_slip:creep", (0.45, 8.0), {"holding_n": 0.45, "creep_n_s_m": 8.0}),
        ("buckling", (0.12, 0.05), {"euler_n_m2": 3e-4, "free_length_m": 0.05}),
        ("buckling:offset", (0.12, 0.05, 0.1), {"euler_n_m2": 3e-4, "free_length_m": 0.05}),
    ],
)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_what_gives_way_is_fitted_by_the_force_that_would_be_there_without(
    form: str, shape: tuple[float, ...], parameters: dict[str, float], sense: float
) -> None:
    """Also where the cell shows the reaction; what is fitted, as a model.yaml, gives the force."""
    name, zero_n = form.partition(":")[0], shape[2] if len(shape) > 2 else 0.0
    tared = recorded(body(0.03, 0.0, 0.0, "sensor"), body(0.0), effect(name, **parameters), rate_hz=FINE_HZ)
    assert tared.force_n is not None
    read_n = sense * (tared.force_n + zero_n)
    recording = replace(tared, force_n=read_n)
    cleaned = clean(recording)
    regression = conditioned(recording, cleaned)
    at = {"bias": (), form: shape} if zero_n else {form: shape}
    fit, plain = regression.fit(at), regression.fit({"bias": ()})
    before, after = (np.std(regression.residual(each)[regression.rows]) for each in (plain, fit))
    assert fit.feasible and after < 0.25 * before
    assert sense * fit.coefficients[2] == pytest.approx(25.0, rel=0.15)
    found = Analysis(cleaned, regression, Search(regression, []), plain, fit, recording, None)
    said = sense * extended_model(found, "made").runtime().forces_n(Motion.of(*motion(FINE_HZ)))
    assert np.std((said - read_n)[200:-200]) < 0.3 * before
    unmeasured = regression.like(regression.signals, fit)
    assert np.std(unmeasured.predicted(fit) - regression.predicted(fit)) < 0.5 * before


def test_without_a_cause_only_the_noise_decides_what_is_said() -> None:
    assert diagnose(recorded(body(0.03))).diagnosis.verdict == "nothing_missing"
    slow = diagnose(recorded(body(0.03), rate_hz=25.0)).diagnosis
    assert (slow.verdict, slow.noise_floor_n) == ("nothing_found", None)
    assert slow.next_motion


def test_a_spring_beside_a_slow_force_of_its_own_is_given_no_resonance() -> None:
    """The force wanders with the position, as where a hand holds both; the search bends the spring for it."""
    rng, t = np.random.default_rng(5), np.arange(1400) / 100.0
    quick = np.interp(t, np.arange(0.0, 62.0, 2.0), rng.standard_normal(31))
    size = np.interp(t, np.arange(0.0, 61.0, 3.0), rng.standard_normal(21))
    walk = np.interp(t, np.arange(0.0, 62.0, 2.0), np.cumsum(rng.standard_normal(31)))
    strokes = 5e-3 * (1.0 + 0.3 * size) * np.sin(2.0 * np.pi * np.cumsum(0.8 + 0.3 * quick) / 100.0)
    slow = 0.2 * gaussian_filter1d(walk, 100.0)
    force = 100.0 * strokes - slow + 0.01 * rng.standard_normal(len(t))
    found = diagnose(Recording("slow", t, strokes + 8e-3 * slow, force, "slow.csv")).diagnosis
    assert (found.verdict, found.follows[0].variable) == ("unexplained", "time")


def test_strokes_of_one_speed_do_not_tell_distance_from_time() -> None:
    """Friction that builds up over 1 mm, in strokes of three lengths at 4.8 mm/s, as on a tensile tester."""
    ends_m = 1e-3 * np.array([0.0, 4, -4, 8, -8, 12, -12, 4, -8, 8, -4, 0])
    way_m = np.cumsum(np.abs(np.diff(ends_m, prepend=0.0)))
    t = np.arange(1500) / 50.0
    x = np.interp(t, way_m / 4.8e-3, ends_m)
    rubs = model(effect("presliding_hysteresis", force_n=0.1, stiffness_n_m=100.0))
    force = 30.0 * x + rubs.runtime().forces_n(Motion.of(t, x, np.gradient(x, t), np.zeros_like(t)))
    found = diagnose(noisy(t, x, force)).diagnosis
    assert found.verdict == "not_separable"
    assert found.next_motion == EXCITATION


def test_harmonic_of_a_creeping_motion_is_no_pulsation() -> None:
    """A crank that stands first, and whose middle creeps; its damper saturates, which has no name here."""
    t = np.arange(1500) / 100.0
    running_s = np.maximum(t - 1.4, 0.0)
    turned = 2.0 * np.pi * 0.94 * running_s
    x = 6e-3 * (1.1 - np.cos(turned) - 0.1 * np.cos(2.0 * turned)) - 4e-4 * running_s
    force = 0.8 * np.tanh(np.gradient(x, t) / 5e-3) + 33.0 * x
    found = diagnose(noisy(t, x, force)).diagnosis
    assert "pulsation" not in found.suspected


def test_weight_of_a_joint_is_named_where_the_position_is_an_angle() -> None:
    """A link of 2.6 N m that hangs at .4 rad, moved from .2 to 2.3 rad."""
    t, x, v, a = (each * scale for each, scale in zip(motion(100.0), (1.0, 80.0, 80.0, 80.0), strict=True))
    joint = model(
        body(0.2, 0.9, 0.0),
        effect("gravity_load", sine_n=2.6 * np.cos(0.4), cosine_n=-2.6 * np.sin(0.4)),
        effect("coulomb_friction", force_n=0.3),
    )
    force = joint.runtime().forces_n(Motion.of(t, x, v, a))
    recording = replace(noisy(t, x, force), columns={"position": "rad:q", "force": "Nm:tau"})
    assert analyse(replace(recording, columns={}), names=["gravity_load"]).search.names == []
    found = diagnose(recording)
    weight, friction = found.diagnosis.causes
    assert (weight.name, friction.name) == ("gravity_load", "coulomb_friction")
    sine_n, cosine_n = (weight.parameters[name].value for name in ("sine_n", "cosine_n"))
    assert np.hypot(sine_n, cosine_n) == pytest.approx(2.6, rel=0.02)
    assert np.arctan2(-cosine_n, sine_n) == pytest.approx(0.4, abs=0.02)
    said = extended_model(found.analysis, "joint").runtime().forces_n(Motion.of(t, x, v, a))
    assert np.std((said - force)[100:-100]) < 0.02


def test_friction_on_a_setpoint_of_one_frequency_is_no_rounding_of_the_encoder() -> None:
    """A position free of noise, whose levels repeat; tons of mass and a spring cancel along it."""
    t = np.arange(1000) / 50.0
    x = 0.01 * np.sin(np.pi * t)
    found = diagnose(noisy(t, x, 100.0 * x + 0.5 * np.tanh(np.gradient(x, t) / 1e-3))).diagnosis
    assert [cause.name for cause in found.causes] == ["coulomb_friction"]
