"""The devices of one axis: readings as the control loop takes them, faults, calibrations and counters."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from math import ceil
from typing import Any

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.messages import (
    MOST_POSITION_M,
    MOST_VELOCITY_M_S,
    Calibration,
    InstrumentShape,
    within,
)
from forefeel.slave.following import FollowingWatch
from forefeel.slave.gripper import Gripper
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from forefeel.slave.plant.foreign import Point
from forefeel.slave.stage import Stage, StageReading

_NO_FORCE = LoadCellReading(0.0, 0, False)
_SHAPE_NS = 50_000_000  # ns between two shapes, by the rate of their topic


@dataclass(frozen=True, slots=True)
class Devices:
    """The three ports of one axis. `drivers`: by slot, see `Handshake`. `shape_m`: reads the centre line of
    the instrument where the simulated world has one.
    """

    stage: Stage
    gripper: Gripper
    load_cell: LoadCell
    drivers: Mapping[str, str] = field(default_factory=dict)
    shape_m: Callable[[], Sequence[Point]] | None = None


class DeviceWatch:
    """Reads the devices once per tick; `on_fault(device, reason)` is told what fails.

    Attributes:
        stage: the newest readback.
        force: the newest reading of the load cell, not valid any more when it is too old.
        following: whether the stage goes where it is sent; to be told what it was sent.
    """

    def __init__(
        self, devices: Devices, following: FollowingWatch, on_fault: Callable[[str, str], None]
    ) -> None:
        self.stage = StageReading(0.0, 0.0)
        self.force, self._force_ns, self._stamp_ns = _NO_FORCE, 0, 0
        self.following = following
        self._devices = devices
        self._on_fault = on_fault

    def open(self, now_ns: int) -> None:
        """Opens stage, gripper and load cell, and takes a first readback of the stage; all stay open, or
        none.

        Raises:
            DeviceError: one does not answer, or the stage does not say where it is.
        """
        with ExitStack() as opened:  # a stage must not stay enabled when the load cell does not answer
            for device in (self._devices.stage, self._devices.gripper, self._devices.load_cell):
                opened.callback(device.close)
                device.open()
            self._read_stage(now_ns)
            self.following.read(self.stage, now_ns)
            opened.pop_all()

    def close(self) -> None:
        """Closes the devices; one that fails at it does not keep the others from it."""
        with ExitStack() as opened:
            for device in (self._devices.stage, self._devices.gripper, self._devices.load_cell):
                opened.callback(device.close)

    def rearm(self) -> None:
        """Re-arms the stage, then the load cell, after a fault. The first DeviceError ends it; it goes to
        `on_fault` and is not raised.
        """
        for name, device in (("stage", self._devices.stage), ("load_cell", self._devices.load_cell)):
            try:
                device.rearm()
            except DeviceError as error:
                self._on_fault(name, str(error))
                return

    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        """Reads stage, then cell, and keeps the last force, invalid once stale; returns the new readings,
        maybe none. A failure, or a force beyond full scale, goes to `on_fault` and gives one invalid reading
        instead; a stage that fails skips the cell, one that strays is a fault, too, but the cell is read.
        """
        cell, name = self._devices.load_cell, "stage"
        try:
            self._read_stage(now_ns)
            if (strayed := self.following.read(self.stage, now_ns)) is not None:
                self._on_fault(name, strayed)
            name = "load_cell"
            readings = cell.read(now_ns, recording_time_s)
            for reading in readings:
                if not abs(reading.force_n) <= cell.full_scale_n:
                    raise DeviceError(
                        f"load cell = {reading.force_n:g} N: expected at most its full scale, "
                        f"{cell.full_scale_n:g} N"
                    )
        except DeviceError as error:
            self._on_fault(name, str(error))
            readings = (_NO_FORCE,)
        if readings:
            self.force, self._force_ns = readings[-1], now_ns
            self._stamp_ns = now_ns if self.force.stamp_ns is None else self.force.stamp_ns
        elif now_ns - self._force_ns > cell.stale_s * 1e9:
            self.force = self.force._replace(valid=False)
        return readings

    def force_age_s(self, now_ns: int) -> float:
        """Age of the newest reading, by its stamp."""
        return max(0, now_ns - self._stamp_ns) * 1e-9

    def _read_stage(self, now_ns: int) -> None:
        """Reads the stage into `stage`; raises DeviceError beyond the range of the messages."""
        reading = self._devices.stage.read(now_ns)
        if not (
            abs(reading.position_m) <= MOST_POSITION_M and abs(reading.velocity_m_s) <= MOST_VELOCITY_M_S
        ):
            raise DeviceError(
                f"stage = ({reading.position_m} m, {reading.velocity_m_s} m/s): expected at most "
                f"{MOST_POSITION_M:g} m and {MOST_VELOCITY_M_S:g} m/s"
            )
        self.stage = reading


class ShapePublisher:
    """Publishes the shape of the instrument every 50 ms, in the thread of the loop, as an engine requires."""

    def __init__(self, shape_m: Callable[[], Sequence[Point]], publisher: Publisher) -> None:
        self._shape_m, self._publisher = shape_m, publisher
        self._due_ns = 0

    def tick(self, now_ns: int, session_id: int) -> None:
        """Publishes the shape if one is due and there is one, thinned to what a message holds."""
        if now_ns < self._due_ns or not (points := self._shape_m()):
            return
        self._due_ns = now_ns + _SHAPE_NS
        step = ceil(len(points) / InstrumentShape.most_items)
        thinned = [points[i] for i in range((len(points) - 1) % step, len(points), step)]
        x_m, y_m, z_m = (
            tuple(within(value, MOST_POSITION_M) for value in axis) for axis in zip(*thinned, strict=True)
        )
        header = self._publisher.header(session_id, now_ns)
        self._publisher.send(InstrumentShape(**header, x_m=x_m, y_m=y_m, z_m=z_m))


class DeviceReports:
    """Publishes device calibrations and link counters. Simulated drivers have neither."""

    def __init__(self, stage: Stage, load_cell: LoadCell, bus: Bus) -> None:
        self._stage, self._load_cell = stage, load_cell
        self._publisher: Publisher = bus.publisher(topics.CALIBRATION)

    def publish_calibrations(self, session_id: int, now_ns: int) -> None:
        for device in (self._stage, self._load_cell):
            calibration = getattr(device, "calibration", None)
            if isinstance(calibration, StageCalibration | LoadCellCalibration):
                self._publisher.send(_message(calibration, self._publisher, session_id, now_ns))

    def counts(self) -> dict[str, int]:
        """Counts of the drivers, as `stage_...` and `load_cell_...`."""
        return {**_counts("stage", self._stage), **_counts("load_cell", self._load_cell)}


def _message(
    calibration: StageCalibration | LoadCellCalibration, publisher: Publisher, session_id: int, now_ns: int
) -> Calibration:
    """Builds the message of a calibration, with None for the other kind's fields; cuts driver and serial."""
    names = "native_per_m", "gain_n", "residual_n", "hysteresis_n"
    rest: dict[str, Any] = {name: getattr(calibration, name, None) for name in names}
    return Calibration(
        **publisher.header(session_id, now_ns),
        slot="stage" if isinstance(calibration, StageCalibration) else "load_cell",
        driver=calibration.driver[:256],
        serial=calibration.serial[:256],
        date=calibration.date.isoformat(),
        zero=calibration.zero,
        **rest,
    )


def _counts(slot: str, device: Stage | LoadCell) -> dict[str, int]:
    link = getattr(device, "link", None)
    if not isinstance(link, DeviceLink):
        return {}
    counted = list(link.counters.items())  # at once: the driver's thread goes on counting
    return {f"{slot}_{name}": number for name, number in counted if number}
