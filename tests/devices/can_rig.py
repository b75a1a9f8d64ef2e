"""Emulated CAN devices on a bus of this process, and drivers on it in stepped time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from time import monotonic
from typing import Any

import can

from forefeel.common.hardware.link import LinkState
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia402.emulator import Drive402, DriveModel
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.cia404.emulator import Transducer404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.shared.settings import CanSettings
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.plant.presets import PRESETS
from forefeel.slave.plant.settings import StageSettings
from forefeel.testing import SteppedCanBus, SteppedTime, connect, stepped

COUNTS_PER_M = 1e6
DRIVE, CELL = 5, 6
START_M = 0.01
_channels = count()


def new_channel() -> CanSettings:
    """A bus of its own within this process."""
    return CanSettings(interface="virtual", channel=f"test {next(_channels)}")


def virtual_bus(settings: CanSettings) -> can.BusABC:
    """A further participant of it."""
    return can.Bus(interface="virtual", channel=settings.channel)


def mechanics(start_m: float = START_M) -> StageSettings:
    """A stiff, quick drive without play."""
    preset = dict(PRESETS["catheter"]["stage"])
    preset.update(
        travel_lower_m=-0.005,
        travel_upper_m=0.125,
        start_m=start_m,
        bandwidth_hz=60.0,
        velocity_limit_m_s=0.5,
        acceleration_limit_m_s2=20.0,
        encoder_step_m=1e-6,
    )
    return StageSettings(**preset)


def stage_settings(bus: CanSettings, **changed: object) -> Cia402Settings:
    values: dict[str, object] = {
        "driver": "cia402",
        "can": bus,
        "node_id": DRIVE,
        "counts_per_m": COUNTS_PER_M,
        "travel_m": (-0.002, 0.12),
        "max_velocity_m_s": 0.2,
        "sync_hz": 50,
        "heartbeat_s": 0.05,
        "following_error_m": 0.002,
        **changed,
    }
    return Cia402Settings.model_validate(values)


def cell_settings(bus: CanSettings, **changed: object) -> Cia404Settings:
    values: dict[str, object] = {
        "driver": "cia404",
        "can": bus,
        "node_id": CELL,
        "full_scale_n": 10.0,
        "rate_hz": 50,
        **changed,
    }
    return Cia404Settings.model_validate(values)


def drive_on(bus: can.BusABC, start_m: float = START_M, now_s: Callable[[], float] = monotonic) -> Drive402:
    return Drive402(bus, DRIVE, DriveModel(mechanics(start_m), COUNTS_PER_M, rate_hz=1000), now_s)


def cell_on(bus: can.BusABC, now_s: Callable[[], float] = monotonic, **changed: Any) -> Transducer404:  # noqa: ANN401
    sensor = EmulatedSensor(lambda _: 1.25, 50.0, noise_n=0.0)
    return Transducer404(bus, CELL, sensor, now_s=now_s, **changed)


class Rig:
    """A drive and a transducer on one bus, and their drivers.

    Attributes:
        words: every controlword that the drive was given.
    """

    def __init__(
        self, time: SteppedTime, start_m: float, unit: int | None, stage: dict[str, Any], cell: dict[str, Any]
    ) -> None:
        self.time, self.bus = time, new_channel()
        now_s = lambda: time.t_s  # noqa: E731 - of both
        self.drive = drive_on(SteppedCanBus(time, self.bus.channel), start_m, now_s)
        of_unit = {} if unit is None else {"unit": unit}
        self.transducer = cell_on(SteppedCanBus(time, self.bus.channel), now_s, **of_unit)
        for device in (self.drive, self.transducer):
            connect(time, device)
        self.stage = Cia402Stage(stage_settings(self.bus, **stage), time)
        self.cell = Cia404LoadCell(cell_settings(self.bus, **cell), time)
        self.words: list[int] = []
        control = self.drive.model.control

        def noted(word: int) -> None:
            self.words.append(word)
            control(word)

        self.drive.model.control = noted  # type: ignore[method-assign]

    def go(self, to_m: float, seconds: float) -> None:
        """The control loop commands that position for that time; DeviceError when the stage fails."""
        end_ns = self.time.now_ns() + round(seconds * 1e9)
        while self.time.now_ns() < end_ns:
            self.stage.command(to_m, 0.0, self.time.now_ns())
            self.time.run(0.002)

    def readings(self, seconds: float) -> list[LoadCellReading]:
        self.time.run(seconds)
        return list(self.cell.read(self.time.now_ns(), None))

    def until(self, driver: Cia402Stage | Cia404LoadCell, state: LinkState) -> None:
        self.time.run_until(lambda: driver.link.state is state)

    def fault_of(self, driver: Cia402Stage | Cia404LoadCell) -> str:
        self.time.run_until(lambda: driver.link.inhibited is not None)
        return str(driver.link.inhibited)


@contextmanager
def rigged(
    *opened: str,
    start_m: float = START_M,
    unit: int | None = None,
    stage: dict[str, Any] | None = None,
    cell: dict[str, Any] | None = None,
) -> Iterator[Rig]:
    """`opened`: which of `stage` and `cell`; the settings of each that are not the usual ones."""
    with stepped() as time:
        rig = Rig(time, start_m, unit, stage or {}, cell or {})
        try:
            for name in opened:
                getattr(rig, name).open()
            yield rig
        finally:
            rig.stage.close()
            rig.cell.close()
            rig.drive.close()
            rig.transducer.close()
