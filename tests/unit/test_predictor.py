"""The predictor as a whole: where motion tells nothing, after a change, its band, a model from outside."""

import numpy as np
import pytest

from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.estimation.evaluator import Evaluator
from forefeel.common.estimation.learner import Learner
from tests.unit.predictor_samples import Array, contact, drifting, replayed, scored

DELAYS_S = (0.02, 0.3)
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


def test_a_force_that_is_none_right_after_the_third_changes_nothing() -> None:
    evaluator = Evaluator()
    for n, force_n in enumerate((1.0, 1.0, 2.0)):
        evaluator.move(0.001 * n, 0.0, 0.0, 0.0)
        evaluator.hear(0.001 * n, force_n)
    before = evaluator.record.values.tobytes()
    evaluator.hear(0.003, float("nan"))
    assert evaluator.record.values.tobytes() == before


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
