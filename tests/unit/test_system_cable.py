"""The cable's schedule in virtual time: no device, no packet leaves."""

from forefeel.common.transport.settings import ImpairmentSettings
from tests.system.net.shape import S, Way

MS = 1_000_000
PACKET = bytes(125)  # 1000 bits


def way(**settings: float) -> Way:
    found = Way(7)
    found.shape(ImpairmentSettings(**settings))
    return found


def test_a_stall_holds_what_is_under_way_and_gives_it_in_one_burst() -> None:
    one = way(delay_s=0.010)
    one.offer(PACKET, 0)
    one.stall(5 * MS, 2.0)
    for number in range(1, 1000):
        one.offer(PACKET, number * MS)
        assert one.take(number * MS) == []
    end_ns = 5 * MS + 2 * S
    assert one.next_ns == end_ns
    assert [due_ns for due_ns, _ in one.take(end_ns)] == [end_ns] * 1000
    one.offer(PACKET, end_ns + MS)
    assert one.next_ns == end_ns + 11 * MS


def test_a_cut_takes_what_is_under_way_and_a_mended_cable_gives_again() -> None:
    one = way(delay_s=0.010)
    one.offer(PACKET, 0)
    one.cut()
    one.offer(PACKET, MS)
    assert one.next_ns is None and one.take(S) == []
    assert one.counts["cut"] == 2
    one.mend()
    one.offer(PACKET, S)
    assert len(one.take(2 * S)) == 1


def test_what_is_too_large_is_dropped_and_the_rest_passes() -> None:
    one = Way(7)
    one.shape(ImpairmentSettings(), largest_bytes=576)
    for size in (40, 576, 577, 1500):
        one.offer(bytes(size), 0)
    assert [len(packet) for _, packet in one.take(0)] == [40, 576]
    assert one.counts["too_large"] == 2
    one.shape(ImpairmentSettings())
    one.offer(bytes(1500), 0)
    assert len(one.take(0)) == 1


def packet_of(source_port: int) -> bytes:
    """IPv4 and TCP, as far as the cable reads them."""
    return bytes(12) + bytes([10, 77, 0, 2, 10, 77, 0, 1]) + source_port.to_bytes(2, "big") + bytes(18)


def test_a_forgotten_connection_passes_no_more_and_a_new_one_does() -> None:
    one = way(delay_s=0.010)
    one.offer(packet_of(40_001), 0)
    one.forget()
    assert len(one.take(S)) == 1, "what is under way arrives"
    for port in (40_001, 40_002, 40_001, 40_002):
        one.offer(packet_of(port), S)
    assert [packet for _, packet in one.take(2 * S)] == [packet_of(40_002)] * 2
    assert one.counts["forgotten"] == 2


def test_a_new_shape_overtakes_nothing_that_is_under_way() -> None:
    one = way(delay_s=0.100)
    one.offer(b"first", 0)
    one.shape(ImpairmentSettings(delay_s=0.001))
    one.offer(b"second", MS)
    assert [packet for _, packet in one.take(S)] == [b"first", b"second"]
