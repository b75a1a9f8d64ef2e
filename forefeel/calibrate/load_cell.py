"""`forefeel calibrate load-cell`: unloaded, every load up and down, unloaded again; the line through them."""

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
from forefeel.calibrate.procedure import about, ask_person, introduce, require_options, write
from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import ConfigurationError, DeviceError, RunError
from forefeel.common.hardware.calibration import CellScale, LoadCellCalibration
from forefeel.interrupt import breakable, heeded
from forefeel.probe.configured import device_of
from forefeel.slave.load_cell import NativeLoadCell, NativeReading
from forefeel.terminal import say

_POLL_NS = 5_000_000  # ns between two looks for readings, which a queue keeps meanwhile
_SLOWEST_S = 30.0  # s in which a level must be read: a cell of one reading a second needs some ten


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
    forces = _loads(options)
    device = device_of(options.config, options.axis, "load_cell")
    full_scale_n, largest_n = device.settings.full_scale_n, max(map(abs, forces))
    if largest_n > full_scale_n:
        raise ConfigurationError(
            f"load {largest_n:.4g} N: expected at most load_cell.full_scale_n = {full_scale_n:g} N"
        )
    (low_n, high_n), sign, steps = range_of(forces), device.settings.sign, list[Step]()
    time = clock or MonotonicClock()
    cell: NativeLoadCell = device.driver.make(device.settings, time)
    with heeded(), breakable(lambda: "calibration interrupted; nothing was written"), closing(cell):
        cell.open_native()
        serial = introduce(device, cell.link)
        for force_n in walk_of(forces):
            level = _level(cell, time, force_n, options)
            newton = cell.scale.newton_per_native
            require_steady(level, newton, high_n - low_n, _in_words(force_n), options.steady_share)
            steps.append(Step(force_n, level))
            say(f"  {level.mean:.8g} +- {level.std:.2g}, {level.readings} readings")
    # the sign of the settings is applied after the calibration, so it is no part of the gain
    found = fit([Step(sign * step.force_n, step.level) for step in steps])
    require_line(found, high_n - low_n, options.residual_share)
    _require_scale(found, cell.scale, sign)
    write(
        options.out,
        LoadCellCalibration(
            **about(device, serial, today or date.today(), options.valid_days),
            **found._asdict(),
            range_n=(low_n, high_n),
            temperature_c=options.temperature_c,
            points=tuple((step.level.mean, step.force_n) for step in steps),
        ),
        f"Gain        {found.gain_n:.6g} N per native unit, zero {found.zero:.6g}, {len(steps)} steps",
        f"Residual    {found.residual_n:.3g} N rms, {found.residual_n / (high_n - low_n):.2%} of the range",
        f"Hysteresis  {found.hysteresis_n:.3g} N, the largest difference between up and down",
    )


def _loads(options: LoadCellCalibrationOptions) -> list[float]:
    """The loads in N; everything that can be refused without a device is."""
    share = (1e-6, 0.1, " of the range")
    require_options(
        options.out,
        options.overwrite,
        ("--average", options.average_s, 0.5, 60.0, " s"),
        ("--settle", options.settle_s, 0.0, 60.0, " s"),
        ("--steady", options.steady_share, *share),
        ("--max-residual", options.residual_share, *share),
        ("--valid-days", options.valid_days, 1, 3650, " days"),
    )
    weights = options.weights or ""
    if (options.weights is None) is (options.forces is None):
        raise ConfigurationError("--weights, --forces: expected one of them")
    if options.forces is not None:
        return forces_of(options.forces, 1.0, "--forces")
    forces = forces_of(weights, STANDARD_GRAVITY_M_S2, "--weights")
    if min(forces) < 0.0:
        raise ConfigurationError(f"--weights {weights}: a weight below 0; expected kg, or --forces in N")
    return forces


def _require_scale(found: CalibrationFit, scale: CellScale, sign: int) -> None:
    """Refuses what would be refused when it is loaded."""
    if found.gain_n < 0.0:
        raise RunError(
            f"the reading goes the wrong way with load_cell.sign = {sign}: expected a gain above 0; write "
            f"load_cell.sign: {-sign}, or turn the load round; nothing was written"
        )
    if flaw := scale.flaw(found.gain_n, found.zero):
        raise RunError(f"{flaw}; correct load_cell, or the weights; nothing was written")


def _level(
    cell: NativeLoadCell, clock: SleepingClock, force_n: float, options: LoadCellCalibrationOptions
) -> Level:
    """Has the load applied and reads it, once it has settled."""
    load = _in_words(force_n)
    ask_person("Unload the cell" if not force_n else f"Apply {load}", ", then press Enter", options.yes)
    settled_ns = clock.now_ns() + round(options.settle_s * 1e9)
    found: list[NativeReading] = []
    while not _enough(found, clock.now_ns() - settled_ns, options.average_s):
        read = cell.read_native(clock.now_ns())  # meanwhile, too: a cell that fails is noticed
        found += read if clock.now_ns() > settled_ns else ()
        clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
    if not all(reading.valid for reading in found):
        raise RunError(f"{load}: readings that are not valid; expected the cell within its range")
    times_s = [(reading.stamp_ns - found[0].stamp_ns) * 1e-9 for reading in found]
    return level_of(times_s, [reading.native for reading in found])


def _enough(found: list[NativeReading], passed_ns: int, average_s: float) -> bool:
    if passed_ns > _SLOWEST_S * 1e9:
        raise DeviceError(
            f"{len(found)} readings within {_SLOWEST_S:g} s: expected at least {LEAST_READINGS}"
        )
    return len(found) >= LEAST_READINGS and found[-1].stamp_ns - found[0].stamp_ns >= average_s * 1e9


def _in_words(force_n: float) -> str:
    return f"{force_n:.5g} N ({force_n / STANDARD_GRAVITY_M_S2:.5g} kg)" if force_n else "no load"
