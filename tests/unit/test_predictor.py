"""The predictor as a whole: idle motion, a change, its band, a model, a wrong prior, measured recordings."""

from pathlib import Path

import numpy as np
import pytest

from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.causes.motion import Motion
from forefeel.common.estimation.contact_prior import CONTACT, exactly, widened
from forefeel.common.estimation.evaluator import Evaluator
from forefeel.common.estimation.learner import Learner
from forefeel.common.recording.loading import load_recording
from tests.unit.contact_samples import DT_S, TRUE, session, world
from tests.unit.predictor_samples import Array, Sample, contact, drifting, replayed, scored

DELAY_S, DELAYS_S = 0.3, (0.02, 0.3)
T = np.arange(1500) / 100.0


@pytest.mark.parametrize(
    ("x", "delay_s"), [(1e-3 * T, 0.02), (np.full_like(T, 0.01), 0.3)], ids=["constant speed", "standstill"]
)
def test_motion_that_tells_nothing_costs_at_most_5_percent_of_the_hold(x: Array, delay_s: float) -> None:
    sample = drifting(x, T, 0)
    said, rows = replayed(sample, delay_s), scored(sample, delay_s)
    assert said.rms(sample.f, rows) <= 1.05 * said.zoh_rms(sample.f, rows)


@pytest.mark.parametrize("factor", [3.0, 0.4])
def test_another_tissue_is_learned_within_seconds(factor: float) -> None:
    sample = contact(40.0, changed=factor)
    said = replayed(sample, 0.3)
    before = (sample.t > 10.0) & (sample.t < 20.0)
    after = (sample.t > 25.0) & (sample.t < 35.0)
    assert said.rms(sample.f, after) < 2.5 * max(1.0, factor) * said.rms(sample.f, before)
    assert said.rms(sample.f, after) < 0.25 * said.zoh_rms(sample.f, after)


@pytest.mark.parametrize("delay_s", DELAYS_S)
def test_the_band_covers_95_percent_and_is_narrow(delay_s: float) -> None:
    sample = contact(25.0)
    said, rows = replayed(sample, delay_s), scored(sample, delay_s)
    inside = ((said.low <= sample.f) & (sample.f <= said.high))[rows]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert np.mean((said.high - said.low)[rows]) <= 5.0 * said.rms(sample.f, rows)
    assert (said.low <= said.force)[rows].all()
    assert (said.force <= said.high)[rows].all()


def test_no_prediction_is_further_from_the_newest_force_than_the_reach() -> None:
    sample, evaluator = contact(5.0), Evaluator()
    learner, beyond = Learner(evaluator), []
    for n in range(len(sample.t)):
        if n >= 60:
            evaluator.hear(sample.t[n - 60], sample.f[n - 60])
            learner.take(sample.t[n - 60], sample.f[n - 60])
        evaluator.snapshot = learner.publish()
        learned = evaluator.snapshot.learned.values
        learned_n, learned["reach_n"] = float(learned["reach_n"]), 0.01
        evaluator.move(sample.t[n], sample.x[n], sample.x[n], 0.0)
        said = evaluator.predict()
        if said is not None:
            beyond.append(abs(said.force_n - sample.f[n - 60]))
    assert max(beyond) == pytest.approx(0.01)
    assert learned_n > 0.1


def test_what_a_force_teaches_does_not_depend_on_the_motion_since() -> None:
    random = np.random.default_rng(3)
    t = np.cumsum(random.uniform(5e-3, 15e-3, 1500))
    x = np.where((t > 5.0) & (t < 9.0), 0.0, 0.002 * t * np.sin(3.0 * t))  # wider and wider, with a rest
    learned = []
    for late in 40, 70:
        evaluator = Evaluator()
        learner = Learner(evaluator)
        for n in range(len(t)):
            if n >= 30:  # the loop hears every force at once, whenever the task learns from it
                evaluator.hear(t[n - 30], 20.0 * x[n - 30] ** 2)
            evaluator.move(t[n], x[n], x[n], 0.0)
            evaluator.predict()
            if late <= n < 1400 + late:
                learner.take(t[n - late], 20.0 * x[n - late] ** 2)
        learned.append(learner.publish().learned.values.tobytes())
    assert learned[0] == learned[1]


def wall(factor: float) -> ContactModel:
    """The contact of the samples, as a diagnosis would have it, or a multiple of it."""
    spring = {"mass_kg": 0.0, "damping_n_s_m": 1.5 * factor, "stiffness_n_m": 60.0 * factor}
    effects = [
        {"effect": "mass_damper_spring", "parameters": spring},
        {"effect": "coulomb_friction", "parameters": {"force_n": 0.08 * factor}},
    ]
    return ContactModel.from_mapping({"schema": SCHEMA, "name": "wall", "effects": effects})


def test_a_loaded_model_is_right_at_the_first_stroke_and_costs_little_where_it_is_wrong() -> None:
    sample = contact(12.0)
    first, rows = (sample.t > 0.4) & (sample.t < 1.4), sample.t > 0.7
    cold, right, hard, soft = (
        replayed(sample, 0.3, model=model) for model in (None, wall(1.0), wall(3.0), wall(0.1))
    )
    assert right.rms(sample.f, first) < 0.4 * cold.rms(sample.f, first)
    assert max(hard.rms(sample.f, rows), soft.rms(sample.f, rows)) < 1.1 * cold.rms(sample.f, rows)


# --- a prior that is too soft, and whose wall is too far away ---

SPRING = "mass_damper_spring.stiffness_n_m"
SOFT_AND_FAR = {**TRUE, SPRING: TRUE[SPRING] / 2.0, CONTACT: TRUE[CONTACT] + 0.003}


def strokes() -> Sample:
    """In and out of contact from the first second on."""
    moved = session(8.0, seed=2)
    return Sample(moved.t, moved.x, moved.force_n)


def pushed(duration_s: float) -> Sample:
    """Strokes in front of the wall, of which the prior is right; then, from the fourth second on, 20 mm."""
    t = np.arange(0.0, 10.0, DT_S)
    u = np.clip((t - 4.0) / duration_s, 0.0, 1.0)
    free = 0.003 * (1.0 - np.cos(2.0 * np.pi * 0.5 * np.clip(t, 0.0, 4.0)))
    x: Array = free + 0.02 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    v = np.gradient(x, t)
    force_n = world().runtime().forces_n(Motion.of(t, x, v, np.gradient(v, t)))
    return Sample(t, x, force_n + 0.002 * np.random.default_rng(1).standard_normal(len(t)))


@pytest.mark.parametrize(
    "sample", [strokes(), pushed(0.4), pushed(5.0)], ids=["strokes", "a blow", "a slow push"]
)
def test_a_wall_that_the_prior_has_too_soft_and_too_far_away_is_felt_within_a_second(sample: Sample) -> None:
    said = replayed(sample, DELAY_S, prior=widened(exactly(SOFT_AND_FAR), 1.0))
    touched_s = float(sample.t[np.argmax(sample.x > TRUE[CONTACT])])
    after_s, largest_n = sample.t - touched_s, float(np.abs(sample.f).max())

    first = (after_s >= 0.0) & (after_s < 1.0)
    assert 0.05 * largest_n < said.rms(sample.f, first) < 1.2 * said.zoh_rms(sample.f, first)
    later_s = np.arange(1.0, after_s[-1] - 0.25, 0.25)
    left_n = [said.rms(sample.f, (after_s >= s) & (after_s < s + 0.25)) for s in later_s]
    assert max(left_n) < 0.15 * largest_n


# --- on recordings that others measured ---

BOUNDS = {"seal_o_ring_3bar": 0.225, "presliding_friction": 0.099, "emps_test": 0.170}
"""rms as a share of that of the zero-order hold; they leave 15 % to what it does today."""


@pytest.mark.parametrize("name", BOUNDS)
def test_error_and_band_on_recordings_that_others_measured(name: str, data_dir: Path) -> None:
    recording = load_recording(data_dir / f"{name}.csv")
    assert recording.force_n is not None
    cut = slice(0, 20_000)
    sample = Sample(recording.time_s[cut], recording.position_m[cut], recording.force_n[cut])
    said, rows = replayed(sample, DELAY_S), scored(sample, DELAY_S)
    error_n, zoh_n = (said.force - sample.f)[rows], (said.held - sample.f)[rows]
    rms_n, zoh_rms_n = said.rms(sample.f, rows), said.zoh_rms(sample.f, rows)
    assert np.abs(error_n).max() <= 1.1 * np.abs(zoh_n).max()
    inside = ((said.low <= sample.f) & (sample.f <= said.high))[rows]
    assert 0.93 <= np.mean(inside) <= 0.97
    assert np.mean((said.high - said.low)[rows]) <= 5.0 * rms_n
    assert rms_n <= BOUNDS[name] * zoh_rms_n
