"""The first experiments of anyone with a bench: a step of the force, a ramp and hold."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.extended_model import extended_model
from forefeel.diagnosis.identifiability import (
    MOTION_AFTER_CONSTANT_SPEED,
    RIVALS_AT_CONSTANT_SPEED,
    motion_kind,
)
from forefeel.diagnosis.sensor_faults import clean
from forefeel.diagnosis.standard_tests import diagnosed_hold, find_hold
from forefeel.diagnosis.verdict import Diagnosis
from forefeel.results.verdict_text import answer, equation

MASS_KG, DAMPING_N_S_M, STIFFNESS_N_M = 0.4, 3.0, 900.0


def stepped(way: float, rubbing_n: float = 0.0) -> Recording:
    """A rig that is set swinging by steps of .5 N, at 111 Hz, seen by an encoder of 1 um."""
    period_s = 1.0 / 111.0
    t = np.asarray(np.arange(int(6.0 / period_s)) * period_s)
    f = np.where((t > 0.5) & (t < 3.2), 0.5, 0.0)
    stuck = np.where(t > 3.2, rubbing_n, 0.0)  # what dry friction keeps of the first step
    system = [1.0], [MASS_KG, DAMPING_N_S_M, STIFFNESS_N_M]
    numerator, denominator, _ = cont2discrete(system, period_s)
    x = lfilter(numerator[0], denominator, f + stuck)
    return Recording("step", t, np.asarray(1e-6 * np.round(1e6 * way * x)), np.asarray(f), "step.csv")


def ramped(
    fading: bool,
    drift_n_s: float = 0,
    way: float = 1,
    power: float = 1,
    spring_n_m: float = 200,
    ramps: int = 1,
) -> Recording:
    """5 mm in ramps of 4 s, held for 116 s in all; a spring and Maxwell branches of .7, 8 and 60 s, or none,
    that are stretched by a power of the stage's way.
    """
    t = np.arange(2400) / 20.0
    starts_s = 2.0 + 120.0 * np.arange(ramps) / ramps
    stage = np.mean([np.clip((t - start_s) / 4.0, 0.0, 1.0) for start_s in starts_s], axis=0)
    x = 5e-3 * stage**power
    f = spring_n_m * x + drift_n_s * t + 3e-3 * np.random.default_rng(2).standard_normal(len(t))
    for tau_s, stiffness in ((0.7, 80.0), (8.0, 60.0), (60.0, 60.0)) if fading else ():
        decay = np.exp(-0.05 / tau_s)
        f += stiffness * lfilter([decay], [1.0, -decay], np.diff(x, prepend=0.0))
    return Recording("hold", t, way * 5e-3 * stage, f, "hold.csv")


def pulled(seed: int) -> Recording:
    """.5 to 3 mm one way at one rate, after a settling or none, sampled at 10 to 100 Hz, by an extensometer
    with 5 to 30 um of noise; the force stiffens or yields.
    """
    rng = np.random.default_rng(seed)
    rate, way_m, noise_m, last_s = np.exp(
        rng.uniform(np.log([10, 5e-4, 5e-6, 30]), np.log([100, 3e-3, 3e-5, 90]))
    )
    t = np.arange(int(last_s * rate)) / rate
    settled = rng.uniform(0.0, 0.05) * (1.0 - np.exp(-t / (0.01 * last_s)))
    e = t / last_s + settled
    f = 80.0 * (np.tanh(4.0 * e) + rng.choice([0.0, 1.0]) * e**3) + rng.normal(0.0, 0.3, len(t))
    return Recording("pull", t, way_m * e + rng.normal(0.0, noise_m, len(t)), f, "pull.csv")


def diagnosed(recording: Recording) -> Diagnosis:
    found = diagnose(recording)
    assert answer(recording, found.diagnosis, None)
    extended_model(found.analysis, "made")
    return found.diagnosis


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_mass_on_a_spring_that_answers_a_step_lacks_nothing(way: float) -> None:
    found = diagnosed(stepped(way))
    assert found.verdict == "nothing_missing"
    assert ("force_is_the_reaction" in found.flags) == (way < 0.0)
    truth = MASS_KG, DAMPING_N_S_M, STIFFNESS_N_M
    for name, value in zip(("mass_kg", "damping_n_s_m", "stiffness_n_m"), truth, strict=True):
        assert found.baseline.parameters[name] == pytest.approx(value, rel=0.02)
    loaded_from_the_start = stepped(way).cut(slice(56, None))
    assert diagnosed(loaded_from_the_start).verdict == "nothing_missing"


def test_a_rig_that_does_not_come_back_is_not_explained() -> None:
    found = diagnosed(stepped(1.0, rubbing_n=0.3))
    assert found.verdict == "unexplained"
    assert found.next_motion


@pytest.mark.parametrize("switched", [True, False])
def test_sine_that_hardly_answers_the_steps_is_not_explained_by_free_ringing(switched: bool) -> None:
    t = np.arange(5000) / 250.0
    x = 0.01 * np.sin(2.0 * np.pi * 0.8 * t) + 1e-6 * np.random.default_rng(0).normal(size=len(t))
    f = np.where(x > 6e-3, 0.05, 0.0) if switched else np.where((t > 2.0) & (t < 6.0), 1.0, 0.0)
    assert diagnosed(Recording("sine", t, x, f, "sine.csv")).verdict == "unexplained"


@pytest.mark.parametrize("seed", range(30))
def test_noise_of_an_extensometer_makes_no_strokes_of_a_pull(seed: int) -> None:
    recording = pulled(seed)
    assert motion_kind(conditioned(recording, clean(recording)).signals) == "constant_speed"


def test_pull_with_a_noisy_extensometer_has_rivals_and_no_cause() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(150) / 10.0
    f = 4.0 * t + rng.normal(0.0, 0.5, len(t))
    found = diagnosed(Recording("pull", t, 1e-5 * t + rng.normal(0.0, 3e-6, len(t)), f, "pull.csv"))
    assert (found.verdict, found.causes, found.rivals) == ("not_separable", (), (RIVALS_AT_CONSTANT_SPEED,))
    assert found.next_motion == MOTION_AFTER_CONSTANT_SPEED


@pytest.mark.parametrize("noise_m", [0.0, 3e-5])
def test_small_strokes_on_a_pull_are_strokes(noise_m: float) -> None:
    t = np.arange(3000) / 50.0
    strokes = 2e-4 * (np.sin(2.5 * t) + np.sin(5.9 * t + 1.0))
    x = 1e-4 * t + strokes + np.random.default_rng(3).normal(0.0, noise_m, len(t))
    recording = Recording("strokes", t, x, 500.0 * x, "strokes.csv")
    assert motion_kind(conditioned(recording, clean(recording)).signals) == "rich"


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_hold_in_which_the_force_fades_is_relaxation(way: float) -> None:
    found = diagnosed(ramped(fading=True, way=way))
    (cause,) = found.causes
    assert cause.name == "stress_relaxation"
    assert cause.parameters["time_constant_s"].low < 8.0 < cause.parameters["second_time_constant_s"].high
    assert found.extended.parameters["stiffness_n_m"] == pytest.approx(200.0, rel=0.05)
    assert found.held_out.gain_low > 0.8


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("ramps", [1, 3])
def test_sense_of_a_force_that_fades_nearly_away_is_that_of_the_ramp(ramps: int, way: float) -> None:
    found = diagnosed(ramped(fading=True, way=way, spring_n_m=20.0, ramps=ramps))
    assert [cause.name for cause in found.causes] == ["stress_relaxation"]
    assert ("force_is_the_reaction" in found.flags) == (way < 0.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("recording_of", [stepped, lambda way: ramped(fading=True, way=way)])
def test_equation_has_the_bias_of_the_model(recording_of: Callable[[float], Recording], way: float) -> None:
    recording = recording_of(way)
    found = diagnose(replace(recording, force_n=np.asarray(recording.force_n) + 2.5))
    effects = extended_model(found.analysis, "made").effects
    (bias_n,) = (dict(entry.parameters)["force_n"] for entry in effects if entry.effect == "bias")
    assert bias_n == pytest.approx(2.5 * way, abs=0.05)
    assert f" {'+' if way > 0.0 else '-'} {abs(bias_n):.3g}" in equation(found.diagnosis)


def test_hold_after_a_ramp_that_stiffens_is_relaxation() -> None:
    """One branch is told; a second one, of the other sign, would only bend the ramp."""
    (cause,) = diagnosed(ramped(fading=True, power=3.0)).causes
    assert cause.name == "stress_relaxation"
    assert cause.parameters["stiffness_n_m"].low > 0.0


@pytest.mark.parametrize("drift_n_s", [0.0, -3e-3])
def test_a_hold_in_which_the_cell_drifts_names_nothing(drift_n_s: float) -> None:
    found = diagnosed(ramped(fading=False, drift_n_s=drift_n_s))
    assert (found.verdict, found.causes) == ("nothing_found", ())
    assert diagnosed_hold(ramped(fading=False, drift_n_s=drift_n_s, ramps=3)) is None


def test_strokes_after_a_long_rest_are_no_hold() -> None:
    t = np.arange(6000) / 100.0
    x: Floats = np.where(t > 50.0, 5e-3 * np.sin(2 * np.pi * 0.7 * t), 0.0)
    assert find_hold(Recording("rest", t, x, 100.0 * x, "rest.csv")) is None
