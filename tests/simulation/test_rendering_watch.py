"""A prediction that can be no force, at a wall of 1000 N/m over 300 ms."""

from math import nan

import pytest

from forefeel.common.causes.model import SCHEMA
from forefeel.common.events.text import DISTRUSTED
from forefeel.common.topics import FORCE, MASTER_LIMIT, SLAVE_STATE
from forefeel.loopback.plan import LoopbackOptions, make_plan
from tests.simulation.pair import Pair, S

WALL = {"mass_kg": 0.01, "damping_n_s_m": 0.4, "stiffness_n_m": 1000.0}


def in_contact() -> Pair:
    """Armed, a force of .9 N has arrived."""
    plan = make_plan(LoopbackOptions(seed=1))
    effects = [
        {"effect": "contact_loss", "parameters": {"contact_position_m": 0.008}},
        {"effect": "mass_damper_spring", "parameters": WALL},
    ]
    plan.slave["axes"][0]["simulation"]["contact"] = {"schema": SCHEMA, "name": "wall", "effects": effects}
    plan.master["axes"][0]["handle"] |= {"depth_m": 0.015}
    pair = Pair(plan.slave, plan.master)
    pair.to_slave.delay_s = pair.to_master.delay_s = 0.15
    pair.run(3.0)
    while pair.traffic.messages(FORCE)[-1].force_n < 0.9:
        pair.run(0.02)
    pair.run(0.15)
    assert pair.traffic.messages(SLAVE_STATE)[-1].state.value == "armed"
    return pair


@pytest.mark.parametrize("predicted_n", [nan, 1e6, -20.0])
def test_a_prediction_out_of_reach_is_reported_within_300_ms_and_the_stage_stops_within_500(
    predicted_n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = in_contact()
    since_s = pair.run(0.0)
    prediction = pair.master.axes[0]._loop.prediction
    predict = prediction.predict
    monkeypatch.setattr(
        prediction, "predict", lambda *given: (said := predict(*given)) and said._replace(force_n=predicted_n)
    )
    pair.run(0.6)
    reported_s = [m.stamp_ns / S for m in pair.traffic.messages(MASTER_LIMIT) if m.rule == DISTRUSTED]
    assert reported_s[0] - since_s <= 0.3
    (stopped_s,) = (stop_s for stop_s in pair.traffic.times("release") if stop_s > since_s)
    assert stopped_s - since_s <= 0.5
    assert len(pair.master.axes[0].events.notices.drain()) > 0


def test_a_right_prediction_is_believed() -> None:
    pair = in_contact()
    pair.run(4.0)
    assert not [m for m in pair.traffic.messages(MASTER_LIMIT) if m.rule == DISTRUSTED]
