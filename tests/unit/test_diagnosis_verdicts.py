"""Verdicts that say less than a name, and causes that benches have."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import Motion
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, analyse, conditioned
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.diagnosis.identifiability import EXCITATION
from forefeel.diagnosis.search import Search
from forefeel.diagnosis.sensor_faults import clean

RATE_HZ, SECONDS = 250.0, 12.0
FINE_HZ = 500.0  # where an instant or a jump decides


def motion(rate_hz: float = RATE_HZ) -> tuple[Floats, Floats, Floats, Floats]:
    t = np.arange(int(SECONDS * rate_hz)) / rate_hz
    w = 2.0 * np.pi * np.array([0.23, 0.71, 1.9, 4.3])
    size, phase = np.array([9e-3, 4e-3, 1e-3, 2e-4]), np.outer(t, w) + np.arange(4.0)
    x, v, a = np.sin(phase) @ size, np.cos(phase) @ (size * w), -np.sin(phase) @ (size * w * w)
    return t, x + 0.015, v, a


def model(*effects: dict[str, object]) -> ContactModel:
    return ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "made", "effects": list(effects)})


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
    return {"effect": "mass_damper_spring", "parameters": values, "site": site}


def effect(name: str, **parameters: float) -> dict[str, object]:
    return {"effect": name, "parameters": parameters}


def test_play_is_named_by_the_side_of_the_mass() -> None:
    on_the_stage = recorded(body(0.3, 0.0, 0.0, "sensor"), body(0.0), effect("play", width_m=8e-4))
    behind = recorded(body(), effect("backlash", width_m=8e-4))
    for recording, name in ((on_the_stage, "play"), (behind, "backlash")):
        found = diagnose(recording)
        (cause,) = found.diagnosis.causes
        assert cause.name == name
        assert cause.parameters["width_m"].value == pytest.approx(8e-4, rel=0.03)
        said = extended_model(found.analysis, "made").runtime().forces_n(Motion.of(*motion()))
        assert recording.force_n is not None
        assert np.std((said - recording.force_n)[200:-200]) < 4e-3


_SLIDES = body(0.05, 0.9, 0.0, "shaft")
_ROOM = {**effect("pulsation", amplitude_n=0.03, frequency_hz=0.1), "site": "sensor"}


@pytest.mark.parametrize(
    ("name", "effects", "parameters"),
    [
        ("yielding_wall", (_SLIDES,), {"yield_n": 0.5, "stiffness_n_m": 40.0, "contact_position_m": 0.004}),
        ("contact_loss", (_SLIDES, body(0.0, 0.0, 40.0)), {"contact_position_m": 0.01}),
        ("prolapse", (body(0.05),), {"stiffness_n_m": 25.0, "limit_n": 0.5, "again_n": 0.2, "kept": 0.3}),
        ("sensor_drift", (body(), _ROOM), {"rate_n_s": 0.2, "settling_s": 1.5}),
    ],
)
def test_what_remembers_is_named_with_its_numbers_and_again_by_its_model(
    name: str, effects: tuple[dict[str, object], ...], parameters: dict[str, float]
) -> None:
    rate_hz = FINE_HZ if name == "yielding_wall" else RATE_HZ
    recording = recorded(*effects, effect(name, **parameters), rate_hz=rate_hz)
    found = diagnose(recording)
    (cause,) = (each for each in found.diagnosis.causes if each.name != "bias")
    assert cause.name == name
    fitted = {key: cause.parameters[key].value for key in parameters}
    assert fitted == pytest.approx(parameters, rel=0.03, abs=6e-4)
    made = extended_model(found.analysis, "made").runtime().forces_n(Motion.of(*motion(rate_hz)))
    assert recording.force_n is not None
    assert np.sqrt(np.mean((made - recording.force_n)[200:-200] ** 2)) < 6e-3


def test_an_instrument_that_is_loose_in_its_play_lies_where_the_tissue_presses_it() -> None:
    loose = effect("play", width_m=8e-4, rest_position_m=0.015, settling_s=0.04)
    (cause,) = diagnose(recorded(body(0.3, 0.0, 0.0, "sensor"), body(0.0), loose)).diagnosis.causes
    assert cause.name == "play"
    found = {name: each.value for name, each in cause.parameters.items()}
    assert found["width_m"] == pytest.approx(8e-4, rel=0.05)
    assert found["rest_position_m"] == pytest.approx(0.015, abs=1e-4)


def test_tip_of_a_bent_shaft_may_pull_and_push() -> None:
    """The tissue is relaxed amid the stroke; the model.yaml has its preload and gives the force."""
    preload = {**effect("bias", force_n=-0.4), "site": "wall"}
    recording = recorded(body(0.0), preload, effect("capstan", wrap_rad=0.3), effect("bias", force_n=0.1))
    found = diagnose(recording)
    (cause,) = (each for each in found.diagnosis.causes if each.name != "bias")
    assert cause.name == "capstan"
    assert cause.parameters["wrap_rad"].value == pytest.approx(0.3, rel=0.03)
    said = extended_model(found.analysis, "made").runtime().forces_n(Motion.of(*motion()))
    assert recording.force_n is not None
    assert np.std((said - recording.force_n)[200:-200]) < 4e-3


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


def test_a_spring_beside_a_slow_force_of_its_own_is_given_no_delay() -> None:
    """The force wanders with the position, as where a hand holds both; the search bends the spring for it."""
    rng, t = np.random.default_rng(0), np.arange(2000) / 100.0
    quick = np.interp(t, np.arange(0.0, 62.0, 2.0), rng.standard_normal(31))
    size = np.interp(t, np.arange(0.0, 61.0, 3.0), rng.standard_normal(21))
    walk = np.interp(t, np.arange(0.0, 62.0, 2.0), np.cumsum(rng.standard_normal(31)))
    strokes = 5e-3 * (1.0 + 0.3 * size) * np.sin(2.0 * np.pi * np.cumsum(0.8 + 0.3 * quick) / 100.0)
    slow = 0.2 * gaussian_filter1d(walk, 100.0)
    force = 100.0 * strokes - 0.45 * slow + 0.01 * rng.standard_normal(len(t))
    found = diagnose(Recording("slow", t, strokes + 3e-3 * slow, force, "slow.csv")).diagnosis
    assert (found.verdict, found.follows[0].variable) == ("unexplained", "time")


@pytest.mark.parametrize(("damping_n_s_m", "name"), [(9.0, "stress_relaxation"), (0.9, "sensor_lag")])
def test_long_lag_is_named_where_no_contact_relaxes_so(damping_n_s_m: float, name: str) -> None:
    """Behind 9 N s/m the reading is that of a spring and a Maxwell branch of 9 / .15 - 25 N/m, too."""
    recording = recorded(body(0.0, damping_n_s_m), effect("sensor_lag", time_constant_s=0.15))
    (cause,) = diagnose(recording).diagnosis.causes
    assert cause.name == name
    assert cause.parameters["time_constant_s"].value == pytest.approx(0.15, rel=0.05)


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


def test_friction_that_passes_through_zero_over_a_speed_is_dry_friction() -> None:
    """Lubricated friction, and that of most simulators: tanh(v / v_t) in place of the sign."""
    true = {"force_n": 0.15, "transition_speed_m_s": 1e-3}
    found = diagnose(recorded(body(), effect("coulomb_friction", **true), rate_hz=100.0)).diagnosis
    assert [cause.name for cause in found.causes] == ["coulomb_friction"]
    values = {name: interval.value for name, interval in found.causes[0].parameters.items()}
    assert values == pytest.approx(true, rel=0.1)


def test_friction_along_a_path_has_a_level_a_growth_and_a_length_over_which_it_builds_up() -> None:
    """As of a guidewire in a vessel: 40 mN at the entry, 5 N/m of depth, over .5 mm after each reversal."""
    true = {"force_per_length_n_m": 5.0, "force_n": 0.04, "breakaway_m": 5e-4}
    found = diagnose(recorded(body(), effect("position_dependent_friction", **true), rate_hz=100.0)).diagnosis
    assert [cause.name for cause in found.causes] == ["position_dependent_friction"]
    values = {name: interval.value for name, interval in found.causes[0].parameters.items()}
    assert values == pytest.approx(true, rel=0.1)
