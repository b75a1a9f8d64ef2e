"""Whose heartbeats count: what was heard before, or answers what was never sent, is a replay or a forgery."""

import pytest

from forefeel.common.bus import Publisher
from forefeel.common.codec import decode
from forefeel.common.heartbeats import Heartbeats
from forefeel.common.messages import Heartbeat

MS = 1_000_000


class Rig:
    """One end; `beat` gives what it says."""

    def __init__(self) -> None:
        self.said: list[bytes] = []
        self.beats = Heartbeats(Publisher(self.said.append))

    def beat(self, now_ns: int) -> Heartbeat:
        self.beats.beat(1, now_ns)
        return decode(Heartbeat, self.said[-1])


def heartbeat(
    sequence: int, stamp_ns: int, echo_ns: int | None = None, got_ns: int | None = None
) -> Heartbeat:
    return Heartbeat(
        session_id=1, sequence=sequence, stamp_ns=stamp_ns, echo_stamp_ns=echo_ns, echo_receive_ns=got_ns
    )


def test_a_right_answer_compares_the_clocks() -> None:
    rig = Rig()
    assert rig.beats.heard(heartbeat(1, 5), 100)
    sent = rig.beat(200 * MS)
    assert (sent.echo_stamp_ns, sent.echo_receive_ns) == (5, 100)
    assert rig.beats.heard(heartbeat(2, 1220 * MS, 200 * MS, 1210 * MS), 230 * MS)
    assert rig.beats.offset is not None
    assert (rig.beats.offset.offset_ns, rig.beats.offset.round_trip_ns) == (1000 * MS, 20 * MS)


@pytest.mark.parametrize("sequence", [0, 1, 2])
def test_one_that_was_heard_before_says_nothing(sequence: int) -> None:
    rig = Rig()
    rig.beat(200 * MS)
    assert rig.beats.heard(heartbeat(2, 7, 200 * MS, 6), 220 * MS)
    before = rig.beats.offset
    assert not rig.beats.heard(heartbeat(sequence, 9, 200 * MS, 8), 200 * MS)
    assert rig.beats.offset is before
    assert rig.beat(300 * MS).echo_stamp_ns == 7


def test_an_echo_of_what_was_never_sent_says_nothing() -> None:
    rig = Rig()
    rig.beat(200 * MS)
    assert not rig.beats.heard(heartbeat(1, 50 * MS, 200 * MS + 1, 50 * MS), 201 * MS)
    assert rig.beats.offset is None
    assert rig.beats.heard(heartbeat(1, 50 * MS, 200 * MS, 50 * MS), 201 * MS)


def test_after_the_first_answer_one_without_any_says_nothing() -> None:
    rig = Rig()
    rig.beat(200 * MS)
    assert rig.beats.heard(heartbeat(1, 5), 100)
    assert rig.beats.heard(heartbeat(2, 50 * MS, 200 * MS, 50 * MS), 201 * MS)
    assert not rig.beats.heard(heartbeat(3, 60 * MS), 211 * MS)


def test_an_answer_may_take_as_long_as_a_session_outlives() -> None:
    rig = Rig()
    for i in range(250):
        rig.beat(i * 50 * MS)
    assert rig.beats.heard(heartbeat(1, 5, 0, 5), 250 * 50 * MS)
    for i in range(250, 260):
        rig.beat(i * 50 * MS)
    assert not rig.beats.heard(heartbeat(2, 6, 0, 6), 260 * 50 * MS)
