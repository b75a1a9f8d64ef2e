"""Calibrations of load cells and stages: dated YAML files of one device each."""

from datetime import date
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat

from common.config import Settings, load_settings
from common.errors import ConfigurationError

NonZero = Annotated[float, Field(ge=-1e12, le=1e12)]


class LoadCellCalibration(Settings):
    """`F = sign gain_n (native - zero)`, native: what the device gives (N, counts, lbf/1000); `sign`: of the
    settings, not in `gain_n`.

    `residual_n`, `hysteresis_n`: rms of what the line leaves, largest difference between up and down;
    `range_n`: the forces that were applied; `points`: (native, N) of every step.
    """

    format: Literal["forefeel.load_cell_calibration/1"]
    driver: str
    serial: str
    date: date
    valid_days: Annotated[int, Field(ge=1, le=3650)] = 365
    gain_n: NonZero
    zero: float
    residual_n: NonNegativeFloat
    hysteresis_n: NonNegativeFloat
    range_n: tuple[float, float]
    temperature_c: float | None = None
    points: tuple[tuple[float, float], ...]

    def force_n(self, native: float) -> float:
        """The force in N of what the device gives, before the sign of the settings."""
        return self.gain_n * (native - self.zero)


class StageCalibration(Settings):
    """What homing and a run over the travel found: `native = zero + sign native_per_m x`, in device units;
    `sign`: of the settings, not in `native_per_m`.

    `travel_m`: from end to end; `repeatability_m`: the largest difference of the home found twice; None: the
    device does not tell.
    """

    format: Literal["forefeel.stage_calibration/1"]
    driver: str
    serial: str
    date: date
    valid_days: Annotated[int, Field(ge=1, le=3650)] = 365
    zero: float
    native_per_m: Annotated[float, Field(gt=0, le=1e12)]
    travel_m: tuple[float, float]
    repeatability_m: NonNegativeFloat | None


def load_cell_calibration(path: Path, driver: str, serial: str, today: date) -> LoadCellCalibration:
    """The calibration in a file, of the device of that driver with that serial number.

    Raises:
        ConfigurationError: unreadable, out of date, or of another device; what to do.
    """
    found = load_settings(LoadCellCalibration, path)
    _check(path, found, driver, serial, today, "forefeel calibrate load-cell")
    return found


def stage_calibration(
    path: Path, driver: str, serial: str, today: date, travel_m: tuple[float, float]
) -> StageCalibration:
    """As `load_cell_calibration`, of a stage; its travel must hold `travel_m`."""
    found = load_settings(StageCalibration, path)
    _check(path, found, driver, serial, today, "forefeel calibrate stage")
    (low, high), (lowest, highest) = travel_m, found.travel_m
    if low < lowest or high > highest:
        raise ConfigurationError(
            f"{path}: travel_m = [{lowest:g}, {highest:g}]: expected it to cover "
            f"stage.travel_m = [{low:g}, {high:g}]"
        )
    return found


def _check(
    path: Path,
    found: LoadCellCalibration | StageCalibration,
    driver: str,
    serial: str,
    today: date,
    again: str,
) -> None:
    age_days = (today - found.date).days
    for name, value, expected in (("driver", found.driver, driver), ("serial", found.serial, serial)):
        if value != expected:
            raise ConfigurationError(
                f"{path}: {name} = {value!r}: expected {expected!r}, the device that answers; "
                f"`{again}` makes a new one"
            )
    if age_days > found.valid_days:
        raise ConfigurationError(
            f"{path}: date = {found.date}: out of date by {age_days - found.valid_days} days; "
            f"`{again}` makes a new one"
        )
