"""Valid messages whose stamps are ahead, and clocks that are set, over 150 ms each way."""

from typing import Any

import pytest

from forefeel.common.codec import encode
from forefeel.common.messages import Message
from forefeel.common.topics import (
    FORCE,
    HAPTICS,
    MASTER_HEARTBEAT,
    MASTER_STATE,
    SLAVE_HEARTBEAT,
    SLAVE_STATE,
    Topic,
)
from tests.simulation.pair import Pair, S

ARMED_S, CONTACT_S = 2.5, 4.0
STAMP, ANSWER = "stamp_ns", "answers_stamp_ns"


def started(until_s: float) -> Pair:
    pair = Pair()
    pair.to_slave.delay_s = pair.to_master.delay_s = 0.15
    pair.run(until_s)
    return pair


def felt(pair: Pair) -> list[tuple[float | None, ...]]:
    return [(m.rendered_n, m.zoh_n, m.predicted_n) for m in pair.traffic.messages(HAPTICS)]


AHEAD: list[tuple[Topic[Any], str, float]] = [
    (FORCE, STAMP, 0.05),
    (FORCE, STAMP, 1e9),
    (FORCE, ANSWER, 0.3),
    (SLAVE_STATE, STAMP, 10.0),
    (SLAVE_HEARTBEAT, STAMP, 10.0),
    (MASTER_HEARTBEAT, STAMP, 0.3),
]


def test_lone_stamps_ahead_and_echoes_that_lie_are_counted_and_cost_the_hand_nothing() -> None:
    """One after the other; what one of them did would be felt until the end."""
    pair, undisturbed = started(CONTACT_S), started(CONTACT_S)
    for topic, field, ahead_s in AHEAD:
        newest = pair.traffic.newest(topic)
        ahead = {"sequence": newest.sequence + 1000, field: getattr(newest, field) + round(ahead_s * S)}
        put(pair, topic, newest, **ahead)
        pair.run(0.2)
    pair.run(0.2)
    master, slave = pair.traffic.newest(MASTER_STATE).counters, pair.traffic.newest(SLAVE_STATE).counters
    assert (master["forces_ahead"], master["states_ahead"], master["heartbeats_refused"]) == (3, 1, 1)
    assert slave["heartbeats_refused"] == 1
    for topic in (MASTER_HEARTBEAT, SLAVE_HEARTBEAT):  # as if the answer had been there at once
        newest = pair.traffic.newest(topic)
        put(pair, topic, newest, stamp_ns=newest.stamp_ns + 1000, echo_receive_ns=newest.stamp_ns)
    for each, left_s in ((pair, 0.6), (undisturbed, 2.0)):
        each.run(left_s)
    assert felt(pair) == felt(undisturbed)


def put(pair: Pair, topic: Topic[Any], message: Message, **changes: int) -> None:
    pair.stranger().put(topic, encode(message.model_copy(update=changes)))


@pytest.mark.parametrize(("end", "sessions", "steps"), [("slave", 2, 2), ("master", 1, 0)])
def test_a_clock_that_was_set_ends_the_following_within_300_ms_and_the_axis_arms_again(
    end: str, sessions: int, steps: int
) -> None:
    pair = started(ARMED_S)
    before_s = pair.run(0.0)
    (pair.slave_host if end == "slave" else pair.master_host).step(10 * S)
    pair.run(0.3)
    (stopped_s,) = pair.traffic.times("watchdog")
    assert stopped_s % 10 - before_s < 0.3
    pair.run(0.2)
    pair.master.axes[0].report(pair.master_host.clock.now_ns())
    assert pair.traffic.newest(MASTER_STATE).counters.get("clock_steps", 0) == steps
    pair.run(5.0)
    assert pair.traffic.newest(SLAVE_STATE).state.value == "armed"
    assert len(pair.traffic.times("session_opened")) == sessions
