"""The calibrations that a run carries in its recording: a metadata table for each device that has one."""

from typing import Any

from forefeel.common.config import load_settings
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.settings import DaemonSettings
from forefeel.probe.configured import configured

_KINDS: dict[str, Any] = {"load_cell": LoadCellCalibration, "stage": StageCalibration}


def calibrations(settings: DaemonSettings) -> dict[str, dict[str, str]]:
    """Tables by name (`calibration insertion/load_cell`): file, driver, serial, date, what was found.

    Raises:
        ConfigurationError: a calibration can not be read.
    """
    tables: dict[str, dict[str, str]] = {}
    for device in configured(settings):
        path = getattr(device.settings, "calibration", None)
        if path is not None:
            found = load_settings(_KINDS[device.driver.slot], path)
            values = found.model_dump(mode="json", exclude={"points"})
            texts = {name: _text(value) for name, value in values.items() if value is not None}
            tables[f"calibration {device.axis}/{device.driver.slot}"] = {"file": path.name, **texts}
    return tables


def _text(value: object) -> str:
    return " ".join(map(repr, value)) if isinstance(value, list) else str(value)
