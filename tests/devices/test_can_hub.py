"""The slcan hub's pure parts: arbitration, wire time, adapters."""

import pytest

from forefeel.devices.canopen.hub import CanWire, SlcanAdapter, frame_s
from forefeel.devices.canopen.slcan import Frame


@pytest.mark.parametrize(
    ("frame", "bits"),
    [(Frame(0x80, b""), 55), (Frame(1, bytes(8)), 135), (Frame(1, bytes(8), True), 160)],
)
def test_worst_case_bits_of_a_frame(frame: Frame, bits: int) -> None:
    """135 and 160 bits for eight bytes: Davis et al. (2007)."""
    assert frame_s(frame, 1_000_000) == pytest.approx(bits * 1e-6)


def test_the_lowest_identifier_goes_first_and_the_wire_carries_one_at_a_time() -> None:
    wire = CanWire(1_000_000)
    wire.offer(0, Frame(0x300, bytes(8)))
    assert wire.advance(0.0) == []
    for can_id in (0x200, 0x80, 0x100):
        wire.offer(1, Frame(can_id, bytes(8)))
    times = {}
    for i in range(1, 100):
        for _, frame in wire.advance(i * 10e-6):
            times[frame.can_id] = i
    assert list(times) == [0x300, 0x80, 0x100, 0x200]
    assert list(times.values()) == [14, 27, 41, 54]
    assert wire.busy_s == pytest.approx(4 * 135e-6)


def test_an_adapter_opens_answers_and_refuses() -> None:
    adapter = SlcanAdapter(500_000)
    assert adapter.receive(b"t1230\r") == ([], b"\x07")
    assert adapter.receive(b"C\rS6\rO\r") == ([], b"\r\r\r")
    assert adapter.open
    frames, answer = adapter.receive(b"t1232AABB\r")
    assert [(f.can_id, f.data) for f in frames] == [(0x123, b"\xaa\xbb")]
    assert answer == b"\r"
    assert adapter.receive(b"t1239AABB\rS8\rW\r") == ([], b"\x07\x07\x07")
    assert adapter.receive(b"V\rF\r")[1] == b"V1013\rF00\r"
    assert adapter.receive(b"C\rt1230\r") == ([], b"\r\x07")
    assert adapter.counts["refused"] == 5


def test_another_bitrate_than_the_bus_hears_nothing() -> None:
    adapter = SlcanAdapter(500_000)
    adapter.receive(b"S8\rO\r")
    assert not adapter.open
