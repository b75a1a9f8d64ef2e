"""Calibrations of load cells and stages: dated YAML files of one device each."""

from datetime import date
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from forefeel.common.config import Settings, load_settings
from forefeel.common.errors import ConfigurationError
from forefeel.common.messages import MOST_FORCE_N, Native

SCALE_FACTOR = 2.0
"""Gain and data sheet agree within it: data sheets are right to some per cent, and a mistaken unit is further
off (a pound-force is 4.4 N, a kilogram-force 9.8 N)."""
_STAGE_TOLERANCE = 0.01
"""Share of the settings' scale: the lead of a screw is right to 0.1 % (ISO 3408-3, grade T10)."""

Serial = Annotated[str, Field(min_length=1, max_length=64)]
"""Serial number to which a calibration is bound."""


class LoadCellCalibration(Settings):
    """`F = sign gain_n (native - zero)`, native: what the device gives (N, counts, lbf/1000); `sign`: of the
    settings, for `gain_n` is positive.

    `residual_n`, `hysteresis_n`: rms of what the line leaves, largest difference between up and down;
    `range_n`: the forces that were applied; `points`: (native, N) of every step.
    """

    format: Literal["forefeel.load_cell_calibration/1"]
    driver: str
    serial: Serial
    date: date
    valid_days: Annotated[int, Field(ge=1, le=3650)] = 365
    gain_n: Annotated[float, Field(gt=0.0, le=1e12)]
    zero: Native
    residual_n: Annotated[float, Field(ge=0.0, le=MOST_FORCE_N)]
    hysteresis_n: Annotated[float, Field(ge=0.0, le=MOST_FORCE_N)]
    range_n: tuple[float, float]
    points: tuple[tuple[float, float], ...]

    def force_n(self, native: float) -> float:
        """The force in N of what the device gives, before the sign of the settings."""
        return self.gain_n * (native - self.zero)


class StageCalibration(Settings):
    """Result of homing and a run over the travel: `native = zero + sign native_per_m x`, in device units;
    `sign`: of the settings, not in `native_per_m`.

    `travel_m`: from end to end.
    """

    format: Literal["forefeel.stage_calibration/1"]
    driver: str
    serial: Serial
    date: date
    valid_days: Annotated[int, Field(ge=1, le=3650)] = 365
    zero: Native
    native_per_m: Annotated[float, Field(gt=0, le=1e12)]
    travel_m: tuple[float, float]


class CellScale(NamedTuple):
    """A load cell by its data sheet: what a native unit is worth, > 0, and its full scale."""

    newton_per_native: float
    full_scale_n: float

    def flaw(self, gain_n: float, zero: float) -> str | None:
        """Text on a gain more than a factor of 2 off the data sheet, or a zero beyond full scale; else None.
        `gain_n`: in N for a native unit, `zero`: in native units.
        """
        low_n, high_n = self.newton_per_native / SCALE_FACTOR, self.newton_per_native * SCALE_FACTOR
        if not low_n <= gain_n <= high_n:
            return (
                f"gain_n = {gain_n:.4g}: expected {low_n:.4g} to {high_n:.4g}, within a factor of "
                f"{SCALE_FACTOR:g} of full scale by data sheet ({self.full_scale_n:g} N at "
                f"{self.full_scale_n / self.newton_per_native:.6g} native units)"
            )
        if abs(zero) * self.newton_per_native > self.full_scale_n:
            most = self.full_scale_n / self.newton_per_native
            return f"zero = {zero:.6g}: expected at most {most:.6g} native units, its full scale"
        return None


def load_cell_calibration(
    path: Path, driver: str, serial: str, today: date, scale: CellScale
) -> LoadCellCalibration:
    """Reads a load cell's calibration and checks that it belongs to that driver, serial number and scale.

    Raises:
        ConfigurationError: unreadable, of the future or out of date, of another device, or with a gain or
            zero that is not of such a cell; what to do.
    """
    stored = load_settings(LoadCellCalibration, path)
    _check(path, stored, driver, serial, today)
    if flaw := scale.flaw(stored.gain_n, stored.zero):
        raise ConfigurationError(f"{path}: {flaw}; correct load_cell, or {_again(stored)}")
    return stored


def stage_calibration(
    path: Path,
    driver: str,
    serial: str,
    today: date,
    travel_m: tuple[float, float],
    native_per_m: float,
) -> StageCalibration:
    """Reads a stage's calibration, checked as in `load_cell_calibration`. Raises ConfigurationError, too,
    where its scale is over 1 % off `native_per_m`, or its travel does not cover `travel_m`.
    """
    stored = load_settings(StageCalibration, path)
    _check(path, stored, driver, serial, today)
    if abs(stored.native_per_m - native_per_m) > _STAGE_TOLERANCE * native_per_m:
        raise ConfigurationError(
            f"{path}: native_per_m = {stored.native_per_m:g}: expected {native_per_m:g} within "
            f"{_STAGE_TOLERANCE:.0%}, the scale in the settings; correct stage, or {_again(stored)}"
        )
    (low, high), (lowest, highest) = travel_m, stored.travel_m
    if low < lowest or high > highest:
        raise ConfigurationError(
            f"{path}: travel_m = [{lowest:g}, {highest:g}]: expected it to cover "
            f"stage.travel_m = [{low:g}, {high:g}]"
        )
    return stored


def _check(
    path: Path, stored: LoadCellCalibration | StageCalibration, driver: str, serial: str, today: date
) -> None:
    """Raises ConfigurationError for another driver or serial number, a date after `today`, or one that is
    more than `valid_days` old.
    """
    advice = _again(stored)
    for name, value, expected in (("driver", stored.driver, driver), ("serial", stored.serial, serial)):
        if value != expected:
            raise ConfigurationError(
                f"{path}: {name} = {value!r}: expected {expected!r}, the device that answers; {advice}"
            )
    age_days = (today - stored.date).days
    if age_days < 0:
        raise ConfigurationError(
            f"{path}: date = {stored.date}: expected at most today, {today}; correct this host's clock, or "
            f"{advice}"
        )
    if age_days > stored.valid_days:
        raise ConfigurationError(
            f"{path}: date = {stored.date}: out of date by {age_days - stored.valid_days} days; {advice}"
        )


def _again(stored: LoadCellCalibration | StageCalibration) -> str:
    slot = "stage" if isinstance(stored, StageCalibration) else "load-cell"
    return f"`forefeel calibrate {slot}` makes a new one"
