"""python-can's slcan on our port, and the emulated hub: nothing that an adapter sends ends reception."""

import can
import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import DeviceLink
from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.hub import SlcanAdapter, frame_s
from forefeel.devices.canopen.network import SharedNetwork
from forefeel.devices.canopen.slcan import SlcanBus, frame_of
from forefeel.devices.shared.settings import CanSettings

GOOD = b"t1232AABB"
JUNK = {
    "no hex digit in the identifier": b"t1Z32AABB\r",
    "identifier beyond 11 bits": b"t9232AABB\r",
    "truncated": b"t12\r",
    "length beyond 8": b"t1239AABB\r",
    "length and data disagree": b"t1238AABB\r",
    "odd digits": b"t1232AAB\r",
    "not ASCII": b"t12\xff2AABB\r",
    "a letter nobody knows": b"q1232AABB\r",
    "a bell": b"\x07",
    "a flood without an end": b"0" * 5000 + b"\r",
}


class MemoryPort:
    """The host's end of an adapter: what it is to say, and what it was told."""

    def __init__(self) -> None:
        self.write_timeout: float | None = None
        self.timeout_s: float | None = None
        self.says, self.heard, self.gone = b"", b"", False

    def read(self) -> bytes:
        if self.gone:
            raise DeviceError("gone while reading")
        said, self.says = self.says, b""
        return said

    def write(self, data: bytes) -> None:
        if self.gone:
            raise DeviceError("gone while writing")
        self.heard += data

    def close(self) -> None:
        self.gone = True


def bus_on(port: MemoryPort) -> SlcanBus:
    return SlcanBus("memory", open_port=lambda *_: port)


def received(port: MemoryPort, bus: SlcanBus, *data: bytes) -> list[tuple[int, bytes]]:
    """What the bus makes of bytes that arrive one after the other."""
    found = []
    for each in data:
        port.says = each
        while (message := bus.recv(0.0)) is not None:
            found.append((message.arbitration_id, bytes(message.data)))
    return found


def test_bus_opens_sends_and_receives() -> None:
    port = MemoryPort()
    bus = bus_on(port)
    assert port.heard == b"\rC\rS8\r\rO\r"
    frames = [
        can.Message(arbitration_id=0x123, data=b"\xaa\xbb", is_extended_id=False),
        can.Message(arbitration_id=0x1ABCDEF0, data=bytes(8)),
        can.Message(arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True, dlc=3),
    ]
    port.heard = b""
    for frame in frames:
        bus.send(frame)
    port.says = port.heard
    for frame in frames:
        found = bus.recv(0.0)
        assert found is not None and found.equals(frame, timestamp_delta=None, check_channel=False)
    bus.shutdown()
    bus.shutdown()
    assert port.gone


@pytest.mark.parametrize("junk", JUNK.values(), ids=JUNK)
def test_frame_after_junk_is_delivered_and_junk_counted(junk: bytes) -> None:
    port = MemoryPort()
    bus = bus_on(port)
    assert received(port, bus, *(bytes([byte]) for byte in junk + GOOD + b"\r")) == [(0x123, b"\xaa\xbb")]
    assert sum(bus.counts.values()) == 1
    bus.shutdown()


def test_glued_stamped_and_answered_lines() -> None:
    port = MemoryPort()
    bus = bus_on(port)
    assert received(port, bus, b"t1234AA" + GOOD + b"\r") == [(0x123, b"\xaa\xbb")]
    assert bus.counts["damaged"] == 1
    assert received(port, bus, GOOD + b"1F40\rz\r\rV1013\r") == [(0x123, b"\xaa\xbb")]
    assert bus.counts["damaged"] == 1
    assert frame_of(GOOD + b"1F40") == GOOD
    port.gone = True
    with pytest.raises(can.CanOperationError, match="gone"):
        bus.recv(0.0)
    with pytest.raises(can.CanOperationError, match="gone"):
        bus.send(can.Message(arbitration_id=1))
    bus.shutdown()


def test_damage_is_told_to_every_driver_of_a_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    port = MemoryPort()
    monkeypatch.setattr("forefeel.devices.canopen.network.open_bus", lambda _: bus_on(port))
    shared = SharedNetwork(CanSettings(interface="slcan", channel="memory"))
    links = [DeviceLink("stage"), DeviceLink("cell")]
    port.says = b"t12\r" + GOOD + b"\r"
    assert shared.receive(0.0)
    for link in links * 2:
        shared.update_counters(link)
        assert link.counters == {"bus_damaged": 1}
    port.gone = True
    assert not shared.receive(0.0)
    with pytest.raises(DeviceError, match="gone"):
        shared.check()
    shared.close()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"interface": "slcan", "channel": "/dev/nothing"}, "/dev/nothing: no such port"),
        ({"interface": "slcan", "channel": "/dev/null", "bitrate": 123_456}, "bitrate = 123456"),
        ({"interface": "slcan", "channel": "/dev/null@fast"}, "port@baud"),
        ({"interface": "socketcan", "channel": "can77"}, "socketcan can77: can not be opened"),
    ],
)
def test_bus_that_can_not_be_opened_is_one_line(settings: dict[str, object], says: str) -> None:
    with pytest.raises(DeviceSetupError, match=says) as caught:
        open_bus(CanSettings.model_validate(settings))
    assert "\n" not in str(caught.value)


# --- the hub ---


@pytest.mark.parametrize(
    ("frame", "bits"), [(b"t0800", 55), (b"t0018" + b"00" * 8, 135), (b"T000000018" + b"00" * 8, 160)]
)
def test_worst_case_bits_of_a_frame(frame: bytes, bits: int) -> None:
    """135 and 160 bits for eight bytes: Davis et al. (2007)."""
    assert frame_s(frame, 1_000_000) == pytest.approx(bits * 1e-6)


def test_adapter_opens_answers_and_refuses() -> None:
    adapter = SlcanAdapter()
    assert adapter.receive(b"t1230\r") == ([], b"\x07")
    assert adapter.receive(b"C\rS6\rO\r") == ([], b"\r\r\r")
    assert adapter.open
    assert adapter.receive(GOOD + b"\r") == ([GOOD], b"\r")
    assert adapter.receive(b"t1239AABB\rS8\rW\r") == ([], b"\x07\x07\x07")
    assert adapter.receive(b"C\rt1230\r") == ([], b"\r\x07")
