"""Our CANopen drivers on devices whose CiA 301 stack is durand's, which shares nothing with ours: SDO, PDO,
SYNC, NMT, heartbeat and emergency are its own. Behind it are our drive and our sensor, in stepped time.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import can
import pytest
from durand import DatatypeEnum, MinimalNode, Record, Variable, set_scheduler
from durand.scheduler import VirtualScheduler

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen import cia301
from forefeel.devices.canopen.cia301 import ObjectEntry
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia402.emulator import OBJECTS, OVERCURRENT, DriveModel
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.testing import SteppedCanBus, SteppedTime, stepped
from tests.devices.can_rig import (
    CELL,
    COUNTS_PER_M,
    DRIVE,
    START_M,
    cell_settings,
    mechanics,
    new_channel,
    stage_settings,
)

TYPES = {
    "b": DatatypeEnum.INTEGER8, "h": DatatypeEnum.INTEGER16, "i": DatatypeEnum.INTEGER32,
    "B": DatatypeEnum.UNSIGNED8, "H": DatatypeEnum.UNSIGNED16, "I": DatatypeEnum.UNSIGNED32,
    "f": DatatypeEnum.REAL32,
}  # fmt: skip


class Wire:
    """The bus, with the methods of durand's `NetworkABC`."""

    def __init__(self, bus: SteppedCanBus) -> None:
        self._bus = bus
        self._heard: dict[int, Callable[[int, bytes], None]] = {}
        bus.taken = self.take

    def take(self) -> None:
        while (frame := self._bus.recv(0.0)) is not None:
            heard = self._heard.get(frame.arbitration_id)
            if heard is not None:
                heard(frame.arbitration_id, bytes(frame.data))

    def add_subscription(self, cob_id: int, callback: Callable[[int, bytes], None]) -> None:
        self._heard[cob_id] = callback

    def remove_subscription(self, cob_id: int) -> None:
        del self._heard[cob_id]

    def send(self, cob_id: int, msg: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=cob_id, data=msg, is_extended_id=False))


def node_on(bus: SteppedCanBus, number: int, profile: int, entries: Mapping[ObjectEntry, float]) -> Any:  # noqa: ANN401
    """A node of durand with those objects beside the ones that each has."""
    node = MinimalNode(Wire(bus), number)
    objects = node.object_dictionary
    for entry, value in entries.items():
        variable = Variable(TYPES[entry.kind], "rw", value)
        if entry.sub == 0:
            objects[entry.index] = variable
            continue
        if entry.index not in objects:
            objects[entry.index] = Record()
        objects[entry.index][entry.sub] = variable
    objects.write(0x1000, 0, 0x0002_0000 | profile)
    objects.write(0x1018, 4, 77)
    return node


@pytest.fixture
def time() -> Iterator[SteppedTime]:
    """Time of drivers, devices and durand's scheduler."""
    with stepped() as made:
        scheduler = VirtualScheduler()
        set_scheduler(scheduler)
        made.devices.append(lambda _t_s: scheduler.run(1e-3))
        yield made


class Drive:
    """A drive of 55 lines: our servo, durand's bus."""

    def __init__(self, time: SteppedTime, bus: SteppedCanBus) -> None:
        self.model = DriveModel(mechanics(), COUNTS_PER_M, rate_hz=1000)
        entries = {**OBJECTS, cia301.HEARTBEAT_CONSUMER: 0, cia301.SYNC_PERIOD_US: 0}
        self.node = node_on(bus, DRIVE, cia402.PROFILE, entries)
        objects = self.node.object_dictionary
        for entry in OBJECTS:
            objects.download_callbacks[entry.index, entry.sub].add(self._writer(entry))
        self.node.sync.callbacks.add(lambda: self.model.sync(time.t_s))
        time.devices.append(self.live)

    def _writer(self, entry: ObjectEntry) -> Callable[[int], None]:
        def write(value: int) -> None:
            self.model.objects[entry] = value
            if entry is cia402.CONTROLWORD:
                self.model.control(value)
            elif entry is cia402.TARGET_POSITION:
                self.model.target(value)
            elif entry is cia402.MODE:
                self.node.object_dictionary.write(cia402.MODE_DISPLAY.index, 0, value)

        return write

    def live(self, t_s: float) -> None:
        self.model.advance(t_s)
        objects = self.node.object_dictionary
        objects.write(cia402.STATUSWORD.index, 0, self.model.statusword)
        objects.write(cia402.POSITION_ACTUAL.index, 0, self.model.position)
        for code in self.model.alarms:
            self.node.emcy.set(code, 1)
        self.model.alarms.clear()


def opened_stage(time: SteppedTime) -> tuple[Drive, Cia402Stage]:
    bus = new_channel()
    drive = Drive(time, SteppedCanBus(time, bus.channel))
    stage = Cia402Stage(stage_settings(bus), time)
    stage.open()
    return drive, stage


def go(time: SteppedTime, stage: Cia402Stage, to_m: float, seconds: float) -> None:
    end_ns = time.now_ns() + round(seconds * 1e9)
    while time.now_ns() < end_ns:
        stage.command(to_m, 0.0, time.now_ns())
        time.run(0.002)


def test_the_drive_is_identified_configured_led_and_left_at_rest(time: SteppedTime) -> None:
    drive, stage = opened_stage(time)
    assert stage.link.serial == "0000004D"
    assert drive.model.state.name == "ENABLED"
    assert drive.model.objects[cia402.ABORT_OPTION] == cia402.ABORT_QUICK_STOP
    assert stage.read(time.now_ns()).position_m == pytest.approx(START_M, abs=2e-6)
    go(time, stage, START_M + 0.005, 1.0)
    assert drive.model.position_m == pytest.approx(START_M + 0.005, abs=2e-5)
    assert stage.read(time.now_ns()).position_m == pytest.approx(drive.model.position_m, abs=2e-5)
    stage.close()
    assert drive.model.state.name == "QUICK_STOP"


def test_an_emergency_of_the_drive_is_a_fault_until_rearmed(time: SteppedTime) -> None:
    drive, stage = opened_stage(time)
    drive.model.fail(OVERCURRENT)
    time.run_until(lambda: stage.link.inhibited is not None)
    with pytest.raises(DeviceError, match="emergency 2310"):
        stage.read(time.now_ns())
    time.run_until(lambda: stage.link.state is LinkState.CONFIGURED)
    stage.rearm()
    time.run_until(lambda: drive.model.state is cia402.DriveState.ENABLED)
    stage.close()


def test_a_drive_that_stops_its_heartbeat_is_a_fault(time: SteppedTime) -> None:
    drive, stage = opened_stage(time)
    drive.node.object_dictionary.write(0x1017, 0, 0)
    time.run_until(lambda: stage.link.inhibited is not None)
    assert "heartbeat" in str(stage.link.inhibited)
    stage.close()


@pytest.mark.parametrize(("status", "valid"), [(0, True), (cia404.NOT_VALID | cia404.OVER, False)])
def test_the_transducer_is_read_at_each_sync(time: SteppedTime, status: int, valid: bool) -> None:
    bus = new_channel()
    entries = {cia404.PROCESS_VALUE: 1.25, cia404.UNIT: cia404.NEWTON, cia404.STATUS: status}
    node_on(SteppedCanBus(time, bus.channel), CELL, cia404.PROFILE, entries)
    cell = Cia404LoadCell(cell_settings(bus), time)
    cell.open()
    time.run(1.0)
    readings = list(cell.read(time.now_ns(), None))
    assert len(readings) == pytest.approx(50, abs=2)
    assert {(reading.force_n, reading.valid) for reading in readings} == {(1.25, valid)}
    cell.close()
