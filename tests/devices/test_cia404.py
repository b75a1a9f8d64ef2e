"""CiA 404: units, PDOs, and the published SDO bytes answered by our transducer."""

import math

import can
import pytest

from forefeel.devices.canopen import cia301
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.emulator import Transducer404
from forefeel.devices.emulation.sensing import EmulatedSensor, Sensing
from tests.devices.can_rig import CELL, new_channel, virtual_bus

STRAIN = 0xFA010100  # micrometres per metre


class Talk:
    """A transducer and raw frames to it, in one thread and virtual time."""

    def __init__(self, unit: int = cia404.NEWTON) -> None:
        settings = new_channel()
        self.t_s = 0.0
        self.host = virtual_bus(settings)
        sensor = EmulatedSensor(Sensing(1.0, 5.0, noise_n=0.0), lambda t_s: t_s)
        self.cell = Transducer404(virtual_bus(settings), CELL, sensor, unit, lambda: self.t_s)
        self.frames()

    def frames(self) -> list[can.Message]:
        self.cell.step(0.0)
        return list(iter(lambda: self.host.recv(0.0), None))

    def send(self, can_id: int, data: bytes) -> list[can.Message]:
        self.host.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        return self.frames()

    def close(self) -> None:
        self.host.shutdown()
        self.cell.close()


def test_published_bytes_of_the_unit() -> None:
    """Request and answer of a Baumer DST strain sensor, from its CANopen manual."""
    talk = Talk(unit=STRAIN)
    (answer,) = talk.send(cia301.SDO_TO_DEVICE + CELL, bytes.fromhex("40 31 61 01 00 00 00 00"))
    talk.close()
    assert answer.arbitration_id == cia301.SDO_TO_HOST + CELL
    assert answer.data.hex(" ").upper() == "43 31 61 01 00 01 01 FA"


@pytest.mark.parametrize(
    ("code", "newton"),
    [(0x00210000, 1.0), (0x03210000, 1e3), (0xFD210000, 1e-3), (0x00220000, None), (0xFA010100, None)],
)
def test_units_of_force(code: int, newton: float | None) -> None:
    assert cia404.newton_per_unit(code) == (None if newton is None else pytest.approx(newton))


def test_a_reading_at_every_second_sync() -> None:
    talk = Talk()
    pdo = cia404.reading_pdo(CELL, every=2)
    for entry, value in pdo.parameters():
        data = entry.pack(value)
        head = bytes([0x23 | (4 - len(data)) << 2]) + entry.index.to_bytes(2, "little") + bytes([entry.sub])
        assert talk.send(cia301.SDO_TO_DEVICE + CELL, (head + data).ljust(8, b"\0"))[0].data[0] == 0x60
    assert talk.send(cia301.SYNC, b"") == []
    talk.send(cia301.NMT, bytes([cia301.START, CELL]))
    readings = []
    for i in range(8):
        talk.t_s = float(i)
        readings += talk.send(cia301.SYNC, b"")
    talk.close()
    values = [cia404.measured(pdo, bytes(message.data)) for message in readings]
    assert values == [(1.0, 0), (3.0, 0), (5.0, 3), (5.0, cia404.NOT_VALID | cia404.OVER)]


def test_what_can_not_be_a_reading() -> None:
    pdo = cia404.reading_pdo(CELL)
    assert cia404.measured(pdo, bytes(4)) is None
    for status in range(1, 256):
        assert cia404.Measured(1.0, status).flaws
    assert not cia404.Measured(1.0, 0).flaws
    assert cia404.Measured(1.0, 3).flaws == ("not_valid", "overrange")
    assert cia404.Measured(-1.0, 5).flaws == ("not_valid", "underrange")
    assert cia404.Measured(1.0, 0x48).flaws == ("unknown_status",)
    nan = cia404.measured(pdo, cia404.PROCESS_VALUE.pack(math.nan) + b"\0")
    assert nan is not None
    assert nan.flaws == ("not_a_number",)
