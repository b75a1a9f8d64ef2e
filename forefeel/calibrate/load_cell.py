"""`forefeel calibrate load-cell`: unloaded, every load up and down, unloaded again; the line through them."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from forefeel.calibrate.measuring import (
    LEAST_READINGS,
    STANDARD_GRAVITY_M_S2,
    CalibrationFit,
    Level,
    Step,
    fit,
    forces_of,
    level_of,
    range_of,
    require_line,
    require_steady,
    walk_of,
)
from forefeel.calibrate.prompt import Prompt
from forefeel.calibrate.target import check_target, write_calibration
from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError, RunError
from forefeel.common.hardware.calibration import CellScale, LoadCellCalibration
from forefeel.common.hardware.link import DeviceLink
from forefeel.interrupt import breakable, heeded
from forefeel.probe.configured import ConfiguredDevice, device_of
from forefeel.slave.load_cell import NativeLoadCell, NativeReading
from forefeel.terminal import answer, say

# ns between two looks for readings, which a queue keeps meanwhile; chosen, not measured: longer ends a level
# later
_POLL_NS = 5_000_000
# s in which a level must be read; chosen, not measured: a cell of one reading a second needs some ten
_SLOWEST_S = 30.0


@dataclass(frozen=True, slots=True)
class LoadCellCalibrationOptions:
    """What the user asked for. `average_s`: how long each load is read, `settle_s`: after it was changed;
    `steady_share`, `residual_share`: of the range, see `forefeel.calibrate.measuring`.
    """

    config: Path
    axis: str
    out: Path
    weights: str | None = None
    forces: str | None = None
    yes: bool = False
    overwrite: bool = False
    settle_s: float = 1.0
    average_s: float = 0.5
    steady_share: float = 0.005
    residual_share: float = 0.01
    valid_days: int = 365
    temperature_c: float | None = None


def run_load_cell(
    options: LoadCellCalibrationOptions, clock: SleepingClock | None = None, today: date | None = None
) -> None:
    """Calibrates and writes the file.

    Raises:
        InputError: the options, the configuration or the device is not as expected; nothing was written.
        RunError: refused for what was measured, interrupted; nothing was written.
        DeviceError: the cell failed.
    """
    forces = _checked(options)
    device = device_of(options.config, options.axis, "load_cell")
    _require_range(forces, device)
    cell: NativeLoadCell = device.driver.make(device.settings, clock or MonotonicClock())
    person = Prompt(options.yes)
    with heeded(), breakable(lambda: "calibration interrupted; nothing was written"), closing(cell):
        cell.open_native()
        serial = require_serial(cell.link.serial, device)
        say(introduced(device, cell.link))
        steps = _Walk(options, cell, person, clock or MonotonicClock()).run(forces)
    low_n, high_n = range_of(forces)
    found = fit(_signed(steps, device.settings.sign))
    require_line(found, high_n - low_n, options.residual_share)
    _require_scale(found, cell.scale, device.settings.sign)
    _write(options, device, serial, found, steps, today or date.today())


def require_serial(serial: str, device: ConfiguredDevice) -> str:
    """The serial number that the calibration is bound to.

    Raises:
        DeviceSetupError: the device has none.
    """
    if not serial:
        slot, settable = device.driver.slot, hasattr(device.settings, "serial")
        raise DeviceSetupError(
            f"{device.name} on {device.where}: no serial number; expected one to bind the calibration to"
            + (f": write {slot}.serial, the number on its label" if settable else "")
        )
    return serial


def introduced(device: ConfiguredDevice, link: DeviceLink) -> str:
    """Who has answered, in a line."""
    who = link.identity or device.driver.name
    return f"{device.name}: {who}" + ("" if link.serial in who else f", serial {link.serial}")


def _checked(options: LoadCellCalibrationOptions) -> list[float]:
    """The loads in N; everything that can be refused without a device is."""
    check_target(options.out, options.overwrite)
    if (options.weights is None) is (options.forces is None):
        raise ConfigurationError("--weights, --forces: expected one of them")
    _within("--average", options.average_s, 0.5, 60.0, "s")
    _within("--settle", options.settle_s, 0.0, 60.0, "s")
    _within("--steady", options.steady_share, 1e-6, 0.1, "of the range")
    _within("--max-residual", options.residual_share, 1e-6, 0.1, "of the range")
    _within("--valid-days", options.valid_days, 1, 3650, "days")
    if options.forces is not None:
        return forces_of(options.forces, 1.0, "--forces")
    weights = options.weights or ""
    forces = forces_of(weights, STANDARD_GRAVITY_M_S2, "--weights")
    if min(forces) < 0.0:
        raise ConfigurationError(f"--weights {weights}: a weight below 0; expected kg, or --forces in N")
    return forces


def _within(option: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise ConfigurationError(f"{option} {value:g}: expected {low:g} to {high:g} {unit}")


def _require_range(forces: Sequence[float], device: ConfiguredDevice) -> None:
    full_scale_n, largest_n = device.settings.full_scale_n, max(map(abs, forces))
    if largest_n > full_scale_n:
        raise ConfigurationError(
            f"load {largest_n:.4g} N: expected at most load_cell.full_scale_n = {full_scale_n:g} N"
        )


def _signed(steps: Sequence[Step], sign: int) -> list[Step]:
    """The sign of the settings is applied after the calibration, so it is no part of the gain."""
    return [Step(sign * step.force_n, step.level) for step in steps]


def _require_scale(found: CalibrationFit, scale: CellScale, sign: int) -> None:
    """Refuses what would be refused when it is loaded."""
    if found.gain_n < 0.0:
        raise RunError(
            f"the reading goes the wrong way with load_cell.sign = {sign}: expected a gain above 0; write "
            f"load_cell.sign: {-sign}, or turn the load round; nothing was written"
        )
    if flaw := scale.flaw(found.gain_n, found.zero):
        raise RunError(f"{flaw}; correct load_cell, or the weights; nothing was written")


class _Walk:
    """The loads one after the other; each is refused at once when its reading moves."""

    def __init__(
        self, options: LoadCellCalibrationOptions, cell: NativeLoadCell, person: Prompt, clock: SleepingClock
    ) -> None:
        self._options, self._cell, self._person, self._clock = options, cell, person, clock

    def run(self, forces: Sequence[float]) -> list[Step]:
        """Every step."""
        low_n, high_n = range_of(forces)
        newton_per_native = self._cell.scale.newton_per_native
        steps: list[Step] = []
        for force_n in walk_of(forces):
            level = self._level(force_n)
            require_steady(
                level, newton_per_native, high_n - low_n, _load(force_n), self._options.steady_share
            )
            steps.append(Step(force_n, level))
            say(f"  {level.mean:.8g} +- {level.std:.2g}, {level.readings} readings")
        return steps

    def _level(self, force_n: float) -> Level:
        self._person.wait(f"{'Unload the cell' if force_n == 0.0 else f'Apply {_load(force_n)}'}")
        self._sleep(self._options.settle_s)
        self._cell.read_native(self._clock.now_ns())  # what was measured meanwhile
        found: list[NativeReading] = []
        start_ns = self._clock.now_ns()
        while not self._enough(found, self._clock.now_ns() - start_ns):
            self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
            found += self._cell.read_native(self._clock.now_ns())
        if not all(reading.valid for reading in found):
            raise RunError(
                f"{_load(force_n)}: readings that are not valid; expected the cell within its range"
            )
        first_ns = found[0].stamp_ns
        times_s = [(reading.stamp_ns - first_ns) * 1e-9 for reading in found]
        return level_of(times_s, [reading.native for reading in found])

    def _enough(self, found: list[NativeReading], passed_ns: int) -> bool:
        if passed_ns > _SLOWEST_S * 1e9:
            raise DeviceError(
                f"{len(found)} readings within {_SLOWEST_S:g} s: expected at least {LEAST_READINGS}"
            )
        if len(found) < LEAST_READINGS:
            return False
        return found[-1].stamp_ns - found[0].stamp_ns >= self._options.average_s * 1e9

    def _sleep(self, seconds: float) -> None:
        """Reads on, so that a cell that fails is noticed and no queue runs over."""
        until_ns = self._clock.now_ns() + round(seconds * 1e9)
        while (now_ns := self._clock.now_ns()) < until_ns:
            self._clock.sleep_until_ns(min(until_ns, now_ns + 50_000_000))
            self._cell.read_native(self._clock.now_ns())


def _load(force_n: float) -> str:
    return f"{force_n:.5g} N ({force_n / STANDARD_GRAVITY_M_S2:.5g} kg)" if force_n else "no load"


def _write(
    options: LoadCellCalibrationOptions,
    device: ConfiguredDevice,
    serial: str,
    found: CalibrationFit,
    steps: Sequence[Step],
    today: date,
) -> None:
    calibration = LoadCellCalibration(
        format="forefeel.load_cell_calibration/1",
        driver=device.driver.name,
        serial=serial,
        date=today,
        valid_days=options.valid_days,
        gain_n=found.gain_n,
        zero=found.zero,
        residual_n=found.residual_n,
        hysteresis_n=found.hysteresis_n,
        range_n=range_of([step.force_n for step in steps]),
        temperature_c=options.temperature_c,
        points=tuple((step.level.mean, step.force_n) for step in steps),
    )
    write_calibration(options.out, calibration)
    share = found.residual_n / (calibration.range_n[1] - calibration.range_n[0])
    answer(
        f"Gain        {found.gain_n:.6g} N per native unit, zero {found.zero:.6g}, {len(steps)} steps",
        f"Residual    {found.residual_n:.3g} N rms, {share:.2%} of the range",
        f"Hysteresis  {found.hysteresis_n:.3g} N, the largest difference between up and down",
        f"{options.out}: serial {serial}, {today}, valid {options.valid_days} days",
        document=lambda: calibration.model_dump(mode="json"),
    )
