"""Valid messages whose stamps are ahead, and clocks that are set, over 150 ms each way."""

from functools import cache
from typing import Any

import pytest

from forefeel.common.codec import encode
from forefeel.common.messages import HapticSample, Message
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

ARMED_S, CONTACT_S, END_S = 2.5, 4.0, 6.0
STAMP, ANSWER = "stamp_ns", "answers_stamp_ns"


def started(until_s: float) -> Pair:
    pair = Pair()
    pair.to_slave.delay_s = pair.to_master.delay_s = 0.15
    pair.run(until_s)
    return pair


@cache
def undisturbed() -> list[HapticSample]:
    pair = started(CONTACT_S)
    pair.run(END_S - CONTACT_S)
    return pair.traffic.messages(HAPTICS)


def felt(samples: list[HapticSample]) -> list[tuple[float | None, ...]]:
    return [(sample.rendered_n, sample.zoh_n, sample.predicted_n) for sample in samples]


AHEAD: list[tuple[Topic[Any], str, float]] = [
    (FORCE, STAMP, 0.05),
    (FORCE, STAMP, 1e9),
    (FORCE, ANSWER, 0.3),
    (SLAVE_STATE, STAMP, 10.0),
    (SLAVE_HEARTBEAT, STAMP, 10.0),
    (MASTER_HEARTBEAT, STAMP, 0.3),
]


def test_lone_stamps_ahead_are_counted_and_cost_the_hand_nothing() -> None:
    """One after the other; what one of them did would be felt until the end."""
    pair = started(CONTACT_S)
    for topic, field, ahead_s in AHEAD:
        newest = pair.traffic.messages(topic)[-1]
        ahead = {"sequence": newest.sequence + 1000, field: getattr(newest, field) + round(ahead_s * S)}
        put(pair, topic, newest, **ahead)
        pair.run(0.2)
    pair.run(END_S - CONTACT_S - 0.2 * len(AHEAD))
    assert felt(pair.traffic.messages(HAPTICS)) == felt(undisturbed())
    master = pair.traffic.messages(MASTER_STATE)[-1].counters
    slave = pair.traffic.messages(SLAVE_STATE)[-1].counters
    assert (master["forces_ahead"], master["states_ahead"], master["heartbeats_refused"]) == (3, 1, 1)
    assert slave["heartbeats_refused"] == 1


def test_lone_echoes_that_lie_neither_stop_nor_silence() -> None:
    """As if the answer had been there at once: the shortest round trip that can be."""
    pair = started(CONTACT_S)
    for topic in (MASTER_HEARTBEAT, SLAVE_HEARTBEAT):
        newest = pair.traffic.messages(topic)[-1]
        put(pair, topic, newest, stamp_ns=newest.stamp_ns + 1000, echo_receive_ns=newest.stamp_ns)
    pair.run(END_S - CONTACT_S)
    assert felt(pair.traffic.messages(HAPTICS)) == felt(undisturbed())


def put(pair: Pair, topic: Topic[Any], message: Message, **changes: int) -> None:
    pair.stranger().put(topic, encode(message.model_copy(update=changes)))


@pytest.mark.parametrize(("end", "sessions"), [("slave", 2), ("master", 1)])
def test_a_clock_that_was_set_ends_the_following_within_300_ms_and_the_axis_arms_again(
    end: str, sessions: int
) -> None:
    pair = started(ARMED_S)
    before_s = pair.run(0.0)
    (pair.slave_host if end == "slave" else pair.master_host).step(10 * S)
    pair.run(0.3)
    (stopped_s,) = pair.traffic.times("watchdog")
    assert stopped_s % 10 - before_s < 0.3
    pair.run(0.2)
    pair.master.axes[0].report(pair.master_host.clock.now_ns())
    assert pair.traffic.messages(MASTER_STATE)[-1].counters.get("clock_steps", 0) == (
        2 if end == "slave" else 0
    )
    pair.run(5.0)
    assert pair.traffic.messages(SLAVE_STATE)[-1].state.value == "armed"
    assert len(pair.traffic.times("session_opened")) == sessions
