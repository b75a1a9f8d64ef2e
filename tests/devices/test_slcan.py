"""The slcan parser and our bus on it: nothing that an adapter sends ends or poisons reception."""

import os
import tty
from collections.abc import Iterator

import can
import pytest

from forefeel.common.errors import DeviceSetupError
from forefeel.devices.canopen.bus import SlcanBus, open_bus
from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.canopen.slcan import Frame, SlcanParser, decoded, encoded
from tests.devices.can_rig import new_channel

GOOD = Frame(0x123, b"\xaa\xbb")
JUNK = {
    "no hex digit in the identifier": b"t1Z32AABB\r",
    "truncated": b"t12\r",
    "length beyond 8": b"t1239AABB\r",
    "length and data disagree": b"t1238AABB\r",
    "odd digits": b"t1232AAB\r",
    "not ASCII": b"t12\xff2AABB\r",
    "a letter nobody knows": b"q1232AABB\r",
    "a bell": b"\x07",
    "a flood without an end": b"0" * 5000,
}


@pytest.mark.parametrize(
    "frame", [GOOD, Frame(0x1ABCDEF0, bytes(8), True), Frame(0x7FF, b"", False, True, 3)]
)
def test_there_and_back(frame: Frame) -> None:
    assert decoded(encoded(frame).decode()[:-1]) == (
        frame if frame.remote else frame._replace(length=len(frame.data))
    )
    assert encoded(Frame(0x123, b"\xaa\xbb")) == b"t1232AABB\r"


@pytest.mark.parametrize("junk", JUNK.values(), ids=JUNK)
def test_the_frame_after_junk_is_delivered(junk: bytes) -> None:
    parser = SlcanParser()
    ended = junk if junk.endswith((b"\r", b"\x07")) else junk + b"\r"
    stream = ended + encoded(GOOD)
    found = [frame for byte in stream for frame in parser.feed(bytes([byte]))]
    assert [(frame.can_id, frame.data) for frame in found] == [(0x123, b"\xaa\xbb")]
    assert parser.counts["damaged"] + parser.counts["bells"] + parser.counts["overlong"] == 1


def test_glued_to_a_truncated_frame() -> None:
    parser = SlcanParser()
    found = parser.feed(b"t1234AA" + encoded(GOOD))
    assert [frame.can_id for frame in found] == [0x123]
    assert parser.counts["damaged"] == 1


def test_a_time_stamp_is_tolerated_and_answers_are_no_damage() -> None:
    parser = SlcanParser()
    assert len(parser.feed(b"t1232AABB1F40\rz\r\rV1013\r")) == 1
    assert parser.counts["damaged"] == 0
    assert parser.counts["answers"] == 2


@pytest.fixture
def adapter() -> Iterator[tuple[int, SlcanBus]]:
    """The device's end of a terminal, and the bus on the other."""
    master, end = os.openpty()
    tty.setraw(end)
    bus = SlcanBus(os.ttyname(end))
    try:
        yield master, bus
    finally:
        bus.shutdown()
        os.close(end)
        os.close(master)


def test_the_bus_survives_all_junk(adapter: tuple[int, SlcanBus]) -> None:
    master, bus = adapter
    assert os.read(master, 100) == b"\rC\rS8\rO\r"
    for junk in JUNK.values():
        os.write(master, junk + b"\r" + encoded(GOOD))
        message = bus.recv(1.0)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x123, b"\xaa\xbb")
    bus.send(can.Message(arbitration_id=0x7F, data=b"\x01", is_extended_id=False))
    assert os.read(master, 100) == b"t07F101\r"


def test_the_bus_says_that_the_adapter_is_gone() -> None:
    master, end = os.openpty()
    bus = SlcanBus(os.ttyname(end))
    os.close(end)
    os.close(master)
    with pytest.raises(can.CanOperationError, match="gone"):
        bus.recv(0.1)
    with pytest.raises(can.CanOperationError, match="gone"):
        bus.send(can.Message(arbitration_id=1))
    bus.shutdown()


def test_a_port_is_opened_once(adapter: tuple[int, SlcanBus]) -> None:
    master, bus = adapter
    os.read(master, 100)
    with pytest.raises(DeviceSetupError, match="busy"):
        SlcanBus(os.ttyname(os.open(bus._stream.name, os.O_RDWR | os.O_NOCTTY)))
    os.set_blocking(master, False)
    with pytest.raises(BlockingIOError):
        os.read(master, 100)  # the other's adapter was left alone


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"interface": "slcan", "channel": "/dev/nothing"}, "/dev/nothing: no such port"),
        (
            {"interface": "slcan", "channel": "/dev/null", "bitrate": 123_456},
            "bitrate = 123456: expected one of",
        ),
        ({"interface": "slcan", "channel": "/dev/null@fast"}, "port@baud"),
        ({"interface": "socketcan", "channel": "can77"}, "socketcan can77: can not be opened"),
    ],
)
def test_a_bus_that_can_not_be_opened_is_one_line(settings: dict[str, object], says: str) -> None:
    with pytest.raises(DeviceSetupError, match=says) as caught:
        open_bus(CanSettings.model_validate(settings))
    assert "\n" not in str(caught.value)


def test_virtual_opens() -> None:
    open_bus(new_channel()).shutdown()
