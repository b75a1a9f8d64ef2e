"""What the hand feels across 300 ms, with an arm that the force moves, at a wall stiffer than the arm."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.model import SCHEMA
from forefeel.common.topics import HAPTICS
from forefeel.loopback.plan import LoopbackOptions, Plan, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from tests.simulation.pair import Heard

WALL_N_M = 400.0
"""The synthetic operator's arm has 250 N/m: reflected late, such a wall has a loop gain above one."""


def _felt(**rendering: str | float | bool) -> dict[str, NDArray[np.float64]]:
    """Ten seconds of strokes against the wall: speed of the handle and energy, ms by ms."""
    loop = VirtualLoopback(_plan(rendering), seed=1)
    loop.run(lambda _done_s: None)
    heard = Heard(loop.payloads)
    position_m = heard.column(HAPTICS, "handle_position_m")
    return {"speed_m_s": np.abs(np.gradient(position_m, 1e-3)), "energy_j": heard.column(HAPTICS, "energy_j")}


def _plan(rendering: dict[str, Any]) -> Plan:
    plan = make_plan(LoopbackOptions(seed=1, impairment="paper"))
    slave, master = plan.slave["axes"][0], plan.master["axes"][0]
    wall = {"mass_kg": 0.01, "damping_n_s_m": 0.4, "stiffness_n_m": WALL_N_M}
    effects = [{"effect": "mass_damper_spring", "parameters": wall}]
    slave["simulation"]["contact"] = {"schema": SCHEMA, "name": "wall", "effects": effects}
    slave["simulation"]["load_cell"] = {"full_scale_n": 50.0}
    slave["limits"] = master["limits"] = {"max_force_n": 40.0}
    master["rendering"] = {"max_force_n": 8.0, "max_slew_n_s": 200.0, **rendering}
    master["handle"] |= {"home_m": 0.0, "depth_m": 0.015}
    return replace(plan, duration_s=10.0)


def test_reflecting_the_delayed_force_is_unstable_and_the_predicted_force_is_not() -> None:
    """Without the passivity controller, so that only the prediction makes the difference."""
    late, predicted = (_felt(source=source, passivity_controller=False) for source in ("zoh", "predicted"))
    assert late["energy_j"][-1] < -0.3, "the late force drives the hand"
    assert np.sqrt(np.mean(late["speed_m_s"][-4000:] ** 2)) > 0.05
    assert predicted["energy_j"].min() > -0.02
    assert np.sqrt(np.mean(predicted["speed_m_s"][-4000:] ** 2)) < 0.015


def test_the_passivity_controller_keeps_the_hand_from_being_driven() -> None:
    energy_j = _felt(source="zoh", max_damping_n_s_m=40.0)["energy_j"]
    assert energy_j.min() > -0.1
