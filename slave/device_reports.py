"""What the slave publishes of its devices: the calibrations that their drivers loaded, what they counted."""

from typing import Any, Literal

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.messages import Calibration
from forefeel.slave.load_cell import LoadCell
from forefeel.slave.stage import Stage


class DeviceReports:
    """Of one axis. A driver with hardware has a `link`, and a `calibration` once it has loaded one."""

    def __init__(self, stage: Stage, load_cell: LoadCell, bus: Bus) -> None:
        self._stage, self._load_cell = stage, load_cell
        self._publisher: Publisher = bus.publisher(topics.CALIBRATION)

    def calibrations(self, session_id: int, now_ns: int) -> None:
        """Publishes each one that is loaded."""
        for found in (getattr(device, "calibration", None) for device in (self._stage, self._load_cell)):
            if isinstance(found, StageCalibration | LoadCellCalibration):
                self._publisher.send(_message(found, self._publisher, session_id, now_ns))

    def counts(self) -> dict[str, int]:
        """What the drivers have counted, `stage_...` and `load_cell_...`."""
        return {**_counts("stage", self._stage), **_counts("load_cell", self._load_cell)}


def _message(
    found: StageCalibration | LoadCellCalibration, publisher: Publisher, session_id: int, now_ns: int
) -> Calibration:
    slot: Literal["stage", "load_cell"] = "stage"
    rest: dict[str, Any]
    if isinstance(found, StageCalibration):
        rest = {"native_per_m": found.native_per_m, "repeatability_m": found.repeatability_m}
    else:
        slot = "load_cell"
        rest = {name: getattr(found, name) for name in ("gain_n", "residual_n", "hysteresis_n")}
    return Calibration(
        **publisher.header(session_id, now_ns),
        slot=slot,
        driver=found.driver[:256],
        serial=found.serial[:256],
        date=found.date.isoformat(),
        zero=found.zero,
        **rest,
    )


def _counts(slot: str, device: Stage | LoadCell) -> dict[str, int]:
    link = getattr(device, "link", None)
    if not isinstance(link, DeviceLink):
        return {}
    counted = list(link.counters.items())  # at once: the driver's thread goes on counting
    return {f"{slot}_{name}": number for name, number in counted if number}
