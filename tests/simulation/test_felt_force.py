"""What the hand feels across 300 ms, with an arm that the force moves, at a wall stiffer than the arm."""

from dataclasses import replace

import numpy as np
import pytest

from forefeel.common.causes.model import SCHEMA
from forefeel.common.events.text import DISTRUSTED
from forefeel.common.topics import FORCE, HAPTICS, MASTER_LIMIT
from forefeel.loopback.plan import LoopbackOptions, make_plan
from tests.looped import looped
from tests.network import Traffic, traffic_of

WALL_N_M = 400.0
"""The synthetic operator's arm has 250 N/m: reflected late, such a wall has a loop gain above one."""


def felt(source: str, duration_s: float, stiffness_n_m: float = WALL_N_M, limit_n: float = 40.0) -> Traffic:
    """Strokes against the wall."""
    plan = make_plan(LoopbackOptions(seed=1, impairment="paper"))
    slave, master = plan.slave["axes"][0], plan.master["axes"][0]
    wall = {"mass_kg": 0.01, "damping_n_s_m": 0.4, "stiffness_n_m": stiffness_n_m}
    effects = [{"effect": "mass_damper_spring", "parameters": wall}]
    slave["simulation"]["contact"] = {"schema": SCHEMA, "name": "wall", "effects": effects}
    slave["simulation"]["load_cell"] = {"full_scale_n": 50.0}
    slave["limits"] = master["limits"] = {"max_force_n": limit_n}
    master["rendering"] = {"max_force_n": 8.0, "max_slew_n_s": 200.0, "source": source}
    master["handle"] |= {"home_m": 0.0, "depth_m": 0.015}
    return traffic_of(looped(replace(plan, duration_s=duration_s)))


@pytest.mark.parametrize("source", ["zoh", "predicted"])
def test_the_force_that_is_felt_is_passive(source: str) -> None:
    """Without the passivity limit the delayed force gives .12 J and moves the hand at .05 m/s rms."""
    traffic = felt(source, 6.0)
    speed_m_s = np.gradient(traffic.column(HAPTICS, "handle_position_m"), 1e-3)[-4000:]
    assert traffic.column(HAPTICS, "energy_j").min() > -1e-3
    assert np.sqrt(np.mean(speed_m_s**2)) < 0.015


def test_the_prediction_knows_what_the_slaves_force_limit_leaves_of_a_command() -> None:
    """A wall of 1000 N/m, of which the limit leaves 2 mm where the hand asks for more."""
    traffic = felt("predicted", 10.0, 1000.0, limit_n=2.0)
    predicted = {sample.sequence: sample for sample in traffic.messages(HAPTICS)}
    samples = [sample for sample in traffic.messages(FORCE) if sample.answers_sequence in predicted][-4000:]
    assert sum(sample.force_limited for sample in samples) > 500
    expected = [predicted[sample.answers_sequence or 0] for sample in samples]
    rows = [(p.predicted_n or 0.0, p.zoh_n or 0.0, s.force_n) for p, s in zip(expected, samples, strict=True)]
    *both, true_n = np.array(rows).T
    predicted_n, held_n = (np.sqrt(np.mean((n - true_n) ** 2)) for n in both)
    assert predicted_n < 0.085 * held_n
    assert DISTRUSTED not in {event.rule for event in traffic.messages(MASTER_LIMIT)}
