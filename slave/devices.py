"""The devices of one axis as its control loop sees them: readings that can be believed, faults by name."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

from forefeel.common.errors import DeviceError
from forefeel.common.messages import MOST_POSITION_M, MOST_VELOCITY_M_S
from forefeel.slave.gripper import Gripper
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from forefeel.slave.stage import Stage, StageReading

_NO_FORCE = LoadCellReading(0.0, 0, False)


@dataclass(frozen=True, slots=True)
class Devices:
    """The three ports of one axis. `drivers`: by slot, see `Handshake`."""

    stage: Stage
    gripper: Gripper
    load_cell: LoadCell
    drivers: Mapping[str, str] = field(default_factory=dict)


class DeviceWatch:
    """Reads the devices once per tick; `on_fault(device, reason)` is told what fails.

    Attributes:
        stage: the newest readback.
        force: the newest reading of the load cell, not valid any more when it is too old.
    """

    def __init__(self, devices: Devices, on_fault: Callable[[str, str], None]) -> None:
        self.stage = StageReading(0.0, 0.0)
        self.force, self._force_ns = _NO_FORCE, 0
        self._devices = devices
        self._on_fault = on_fault

    def open(self, now_ns: int) -> None:
        """Opens the devices; all or none.

        Raises:
            DeviceError: one does not answer, or the stage does not say where it is.
        """
        with ExitStack() as opened:  # a stage must not stay enabled when the load cell does not answer
            for device in (self._devices.stage, self._devices.gripper, self._devices.load_cell):
                opened.callback(device.close)
                device.open()
            self._read_stage(now_ns)
            opened.pop_all()

    def close(self) -> None:
        """Closes the devices; one that fails at it does not keep the others from it."""
        with ExitStack() as opened:
            for device in (self._devices.stage, self._devices.gripper, self._devices.load_cell):
                opened.callback(device.close)

    def rearm(self) -> None:
        """A clearing is the explicit act that a device waits for after its fault."""
        for name, device in (("stage", self._devices.stage), ("load_cell", self._devices.load_cell)):
            try:
                device.rearm()
            except DeviceError as error:
                self._on_fault(name, str(error))
                return

    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        """The new readings of the load cell; the newest counts until it is too old."""
        cell, name = self._devices.load_cell, "stage"
        try:
            self._read_stage(now_ns)
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
        elif now_ns - self._force_ns > cell.stale_s * 1e9:
            self.force = self.force._replace(valid=False)
        return readings

    def _read_stage(self, now_ns: int) -> None:
        reading = self._devices.stage.read(now_ns)
        if not (
            abs(reading.position_m) <= MOST_POSITION_M and abs(reading.velocity_m_s) <= MOST_VELOCITY_M_S
        ):
            raise DeviceError(
                f"stage = ({reading.position_m} m, {reading.velocity_m_s} m/s): expected at most "
                f"{MOST_POSITION_M:g} m and {MOST_VELOCITY_M_S:g} m/s"
            )
        self.stage = reading
