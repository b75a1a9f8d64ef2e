"""Leases and heartbeats of a session."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.bus import Publisher
from forefeel.common.codec import Codec, decode
from forefeel.common.heartbeats import Heartbeats
from forefeel.common.messages import Heartbeat
from forefeel.common.topics import MASTER_HEARTBEAT
from forefeel.slave.session import Lease
from tests.messages import usual

MS = 1_000_000
LEASE_NS = 1000 * MS


def test_the_first_heartbeat_may_take_a_round_trip_more_than_the_next() -> None:
    lease = Lease(LEASE_NS, 2000 * MS)
    lease.request(7, 0, at_rest=True)
    assert (lease.renewed, lease.expired_after_s, lease.live(3000 * MS)) == (False, 3.0, False)
    assert lease.renew(7, 2999 * MS)
    assert (lease.renewed, lease.expired_after_s) == (True, 1.0)
    assert lease.live(3998 * MS)
    assert not lease.live(3999 * MS)
    lease.request(8, 4000 * MS, at_rest=True)
    assert (lease.renewed, lease.live(6999 * MS)) == (False, True)


def test_an_id_is_never_accepted_twice_however_many_follow_nor_after_it_was_let_go() -> None:
    lease = Lease(LEASE_NS)
    for i in range(1, 5000):
        assert lease.request(i, i * LEASE_NS, at_rest=True) is None
    now_ns = 4999 * LEASE_NS + 500 * MS
    lease.release(now_ns)
    assert not lease.live(now_ns) and not lease.renew(4999, now_ns)
    for i in (1, 2, 2500, 4999):
        assert lease.request(i, now_ns, at_rest=True) == "this session id was used before"
    assert lease.request(5000, now_ns, at_rest=True) is None


ACTS = st.lists(
    st.tuples(st.booleans(), st.integers(0, 4), st.integers(0, 2000 * MS), st.booleans()), max_size=40
)


@given(ACTS)
def test_there_is_one_writer_at_a_time_and_no_id_returns(acts: list[tuple[bool, int, int, bool]]) -> None:
    lease, now_ns = Lease(LEASE_NS), 0
    ended = set[int]()
    for asks, session_id, pause_ns, at_rest in acts:
        now_ns += pause_ns
        holder, was_live = lease.holder, lease.live(now_ns)
        if asks:
            granted = lease.request(session_id, now_ns, at_rest) is None
            if granted and session_id != holder:
                assert at_rest and not was_live and session_id not in ended | {0}
                ended.add(holder)
            assert granted == (lease.live(now_ns) and lease.holder == session_id)
        else:
            renewed = lease.renew(session_id, now_ns)
            assert renewed == (was_live and session_id == holder)
            assert lease.live(now_ns) == was_live


class End(Heartbeats):
    """One end; `sent` gives what it says."""

    def __init__(self) -> None:
        self.said: list[bytes] = []
        super().__init__(Publisher(Codec, [self.said.append]))

    def sent(self, now_ns: int) -> Heartbeat:
        self.beat(1, now_ns)
        return decode(Heartbeat, self.said[-1])


@pytest.fixture
def end() -> End:
    """It has sent a heartbeat at 200 ms."""
    end = End()
    end.sent(200 * MS)
    return end


def heartbeat(sequence: int, stamp_ns: int, echo_ns: int | None = None) -> Heartbeat:
    """`echo_ns`: stamp of what it answers at once."""
    echo = {"echo_stamp_ns": echo_ns, "echo_receive_ns": None if echo_ns is None else stamp_ns}
    return usual(MASTER_HEARTBEAT, sequence=sequence, stamp_ns=stamp_ns, **echo)


def test_a_right_answer_compares_the_clocks() -> None:
    end = End()
    assert end.receive(heartbeat(1, 1090 * MS), 100 * MS)
    for sent_ms, received_ms in ((200, 100), (250, 230)):
        sent = end.sent(sent_ms * MS)
        assert (sent.echo_stamp_ns, sent.echo_receive_ns) == ((received_ms + 990) * MS, received_ms * MS)
        received = {"echo_stamp_ns": sent_ms * MS, "echo_receive_ns": (sent_ms + 1010) * MS}
        answer = usual(MASTER_HEARTBEAT, sequence=2, stamp_ns=(sent_ms + 1020) * MS, **received)
        assert end.receive(answer, (sent_ms + 30) * MS)
    assert end.offset is not None
    assert (end.offset.offset_ns, end.offset.round_trip_ns) == (1000 * MS, 20 * MS)


@pytest.mark.parametrize("sequence", [0, 1, 2])
def test_one_that_was_heard_before_says_nothing(end: End, sequence: int) -> None:
    assert end.receive(heartbeat(2, 7, 200 * MS), 220 * MS)
    before = end.offset
    assert not end.receive(heartbeat(sequence, 9, 200 * MS), 200 * MS)
    assert end.offset is before
    assert end.sent(300 * MS).echo_stamp_ns == 7


def test_an_echo_of_what_was_never_sent_and_no_echo_after_the_first_say_nothing(end: End) -> None:
    assert end.receive(heartbeat(1, 5), 100)
    assert not end.receive(heartbeat(2, 50 * MS, 200 * MS + 1), 201 * MS)
    assert end.offset is None
    assert end.receive(heartbeat(2, 50 * MS, 200 * MS), 201 * MS)
    assert not end.receive(heartbeat(3, 60 * MS), 211 * MS)


def test_an_answer_may_take_as_long_as_a_session_outlives() -> None:
    end = End()
    for i in range(250):
        end.sent(i * 50 * MS)
    assert end.receive(heartbeat(1, 5, 0), 250 * 50 * MS)
    for i in range(250, 260):
        end.sent(i * 50 * MS)
    assert not end.receive(heartbeat(2, 6, 0), 260 * 50 * MS)
