import pytest

from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.topics import COMMAND, FORCE, MASTER_TIMING, TOPICS, Qos
from forefeel.common.transport.impaired import ImpairedTransport, TraceChunk, crosses
from forefeel.common.transport.impairment import ImpairedLink, ReplayedImpairment
from forefeel.common.transport.memory import MemoryBus

MS = 1_000_000
KEY = COMMAND.taken_key("cell", "insertion")


class Pair:
    """An impaired session, a plain one, and what the handlers got."""

    def __init__(self, inbound: ImpairedLink | None, outbound: ImpairedLink | None) -> None:
        self.runtime, bus = VirtualRuntime(100), MemoryBus()
        clock = self.runtime.clock
        inner = bus.session(clock)
        self.impaired = ImpairedTransport(inner, self.runtime.timers, clock, inbound, outbound)
        self.plain = bus.session(clock)
        self.got: list[tuple[bytes, int]] = []

    def take(self, payload: bytes, stamp_ns: int) -> None:
        self.got.append((payload, stamp_ns))


@pytest.mark.parametrize("inbound", [True, False])
def test_payloads_come_as_the_link_of_their_direction_plans_and_are_stamped_then(inbound: bool) -> None:
    link = ReplayedImpairment([(30,), (), (5, 50)])
    pair = Pair(link, None) if inbound else Pair(None, link)
    taker, giver = (pair.impaired, pair.plain) if inbound else (pair.plain, pair.impaired)
    taker.subscribe(KEY, pair.take)
    put = giver.publisher(KEY, Qos.STREAM)
    for payload in (b"late", b"lost", b"twice"):
        put(payload)
    assert pair.got == []
    pair.runtime.run(1000)
    assert pair.got == [(b"twice", 105), (b"late", 130), (b"twice", 150)]


def test_polled_payloads_are_handed_over_at_the_poll_next_to_their_time() -> None:
    pair = Pair(ReplayedImpairment([(3 * MS,), (), (1_400_000, 1_600_000)]), None)
    poll = pair.impaired.polled(KEY, pair.take)
    put = pair.plain.publisher(KEY, Qos.STREAM)
    for payload in (b"late", b"lost", b"twice"):
        put(payload)
    for _ in range(4):
        poll()
        pair.runtime.run(MS)
    assert pair.got == [(b"twice", 100 + MS), (b"twice", 100 + 2 * MS), (b"late", 100 + 3 * MS)]


def test_all_keys_of_a_direction_share_one_link() -> None:
    pair = Pair(None, ReplayedImpairment([(), (1,)]))
    pair.plain.subscribe(KEY, pair.take)
    pair.plain.subscribe("other", pair.take)
    pair.impaired.publisher(KEY, Qos.STREAM)(b"first")
    pair.impaired.publisher("other", Qos.EVENT)(b"second")
    pair.runtime.run(1000)
    assert pair.got == [(b"second", 101)]


def test_what_does_not_cross_is_not_touched() -> None:
    lossy = ReplayedImpairment([()])
    pair = Pair(lossy, lossy)
    key = MASTER_TIMING.key("cell", "insertion")
    pair.plain.subscribe(key, pair.take)
    pair.impaired.publisher(key, Qos.STATE)(b"timing")
    assert pair.got == [(b"timing", 100)]
    assert pair.impaired.drain_trace() == []


def test_the_trace_tells_what_was_done_and_replays_it() -> None:
    pair = Pair(ReplayedImpairment([(7,)]), ReplayedImpairment([(1,), (), (2, 3)]))
    put = pair.impaired.publisher(KEY, Qos.STREAM)
    for _ in range(2):
        put(b"")
    pair.impaired.subscribe("in", pair.take)
    pair.plain.publisher("in", Qos.STREAM)(b"")
    inbound, outbound = TraceChunk("inbound", 0, ((7,),)), TraceChunk("outbound", 0, ((1,), ()))
    assert pair.impaired.drain_trace() == [inbound, outbound]
    put(b"")
    assert pair.impaired.drain_trace() == [TraceChunk("outbound", 2, ((2, 3),))]
    assert pair.impaired.drain_trace() == []


def test_a_long_trace_comes_in_chunks_and_an_undrained_one_loses_its_oldest() -> None:
    pair = Pair(None, ReplayedImpairment([()]))
    put = pair.impaired.publisher(KEY, Qos.STREAM)
    for _ in range(2500):
        put(b"")
    chunks = [(chunk.first_index, len(chunk.delays_ns)) for chunk in pair.impaired.drain_trace()]
    assert chunks == [(0, 1024), (1024, 1024), (2048, 452)]
    for _ in range(65_536 + 10):
        put(b"")
    assert pair.impaired.drain_trace()[0].first_index == 2510


def test_what_is_on_its_way_at_close_is_dropped() -> None:
    pair = Pair(ReplayedImpairment([(30 * MS,)]), ReplayedImpairment([(30 * MS,)]))
    pair.impaired.subscribe(KEY, pair.take)
    poll = pair.impaired.polled("polled", pair.take)
    pair.plain.publisher("polled", Qos.STREAM)(b"waits")
    poll()
    pair.plain.subscribe("out", pair.take)
    pair.plain.publisher(KEY, Qos.STREAM)(b"in")
    put = pair.impaired.publisher("out", Qos.STREAM)
    put(b"out")
    pair.impaired.close()
    pair.impaired.close()
    put(b"after")
    pair.runtime.run(100 * MS)
    poll()
    assert pair.got == []


def test_what_is_for_the_recorder_only_does_not_cross() -> None:
    local = {topic.name for topic in TOPICS if not crosses(topic.taken_key("c", "a"))}
    assert local == {
        "master/haptics", "master/parameters", "master/timing", "slave/timing", "master/impairment",
        "slave/impairment", "slave/calibration", "slave/cycle", "slave/shape", "master/limit", "master/event",
    }  # fmt: skip
    assert crosses(FORCE.taken_key("c", "a"))
    assert not crosses(FORCE.key("c", "a"))
