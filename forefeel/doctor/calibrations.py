"""When were the devices calibrated, and for how long does that count?"""

from dataclasses import dataclass
from datetime import date
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.calibration import (
    LoadCellCalibration,
    StageCalibration,
    load_cell_calibration,
    stage_calibration,
)
from forefeel.doctor.findings import Finding
from forefeel.probe.configured import ConfiguredDevice

GROUP = "calibration"
# days before the end from which it is amber; chosen, not measured: time to plan a calibration
_SOON_DAYS = 30
_COMMANDS = {"stage": "forefeel calibrate stage", "load_cell": "forefeel calibrate load-cell"}


@dataclass(frozen=True, slots=True)
class Calibrated:
    """A device that can be calibrated. `made` None: it is not; `error`: why the daemon
    refuses its file."""

    name: str
    command: str
    made: date | None = None
    valid_days: int = 0
    error: str = ""


def read_calibration(device: ConfiguredDevice, today: date) -> Calibrated | None:
    """The calibration that the settings name, as the daemon would take it; None for what needs none."""
    command, settings = _COMMANDS.get(device.driver.slot), device.settings
    if command is None or not device.settings.hardware:
        return None
    path: Path | None = getattr(settings, "calibration", None)
    if path is None:
        return Calibrated(device.name, command)
    about = path, device.driver.name, getattr(settings, "serial", None), today
    found: StageCalibration | LoadCellCalibration
    try:
        if device.driver.slot == "stage":
            found = stage_calibration(*about, settings.travel_m, settings.native_per_m)
        else:
            found = load_cell_calibration(*about, settings.scale)
    except ConfigurationError as error:
        return Calibrated(device.name, command, error=str(error))
    return Calibrated(device.name, command, found.date, found.valid_days)


def judge_calibration(found: Calibrated, today: date) -> Finding:
    """Red: the daemon refuses it; amber: none, or out of date within 30 days."""
    if found.error:
        return Finding(GROUP, found.name, "red", found.error, f"{found.command} makes a new one")
    if found.made is None:
        advice = f"{found.command}, then name its file at `calibration:`"
        return Finding(GROUP, found.name, "amber", "never calibrated", advice)
    left_days = found.valid_days - (today - found.made).days
    words = f"calibrated on {found.made}, {left_days} days left"
    if left_days < _SOON_DAYS:
        return Finding(GROUP, found.name, "amber", words, f"{found.command} soon")
    return Finding(GROUP, found.name, "green", words)
