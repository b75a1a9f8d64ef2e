"""A prediction that can be no force, at a wall of 1000 N/m over 300 ms."""

from math import nan

import pytest

from benchmarks.felt_force import Row
from forefeel.common.events.text import DISTRUSTED
from forefeel.common.topics import FORCE, MASTER_LIMIT, SLAVE_STATE
from tests.simulation.pair import Pair, S


@pytest.mark.parametrize("predicted_n", [nan, 1e6, -20.0])
def test_a_prediction_out_of_reach_is_reported_within_300_ms_and_the_stage_stops_within_500(
    predicted_n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That right ones are believed is in test_felt_force.py."""
    plan = Row("wall", 1000.0, 0.3).plan()
    plan.slave["axes"][0]["limits"] = plan.master["axes"][0]["limits"] = {}
    pair = Pair(plan.slave, plan.master)
    pair.to_slave.delay_s = pair.to_master.delay_s = 0.15
    pair.run(2.0)
    while pair.traffic.newest(FORCE).force_n < 0.9:
        pair.run(0.02)
    since_s = pair.run(0.15)
    assert pair.traffic.newest(SLAVE_STATE).state.value == "armed"
    prediction = pair.master.axes[0]._loop.prediction
    predict = prediction.predict
    monkeypatch.setattr(
        prediction, "predict", lambda *given: (said := predict(*given)) and said._replace(force_n=predicted_n)
    )
    pair.run(0.6)
    reported_s = [m.stamp_ns / S for m in pair.traffic.messages(MASTER_LIMIT) if m.rule == DISTRUSTED]
    assert 0.0 < reported_s[0] - since_s <= 0.3
    (stopped_s,) = (stop_s for stop_s in pair.traffic.times("release") if stop_s > since_s)
    assert stopped_s - since_s <= 0.5
    assert pair.master.axes[0].events.notices.drain()
