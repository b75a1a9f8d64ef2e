"""`forefeel calibrate` and `home`: the person who is asked, what the device gives, the dated file.

A load cell: unloaded, every load up and down, unloaded again; the line through them. A stage: home twice, the
way from end to end; asked before it moves.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

from forefeel.calibrate.measuring import (
    LEAST_READINGS,
    STANDARD_GRAVITY_M_S2,
    Level,
    Step,
    fit,
    forces_of,
    level_of,
    range_of,
    require_line,
    require_steady,
    require_travel,
    travel_of,
    walk_of,
)
from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.config import dump_yaml
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError, RunError
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.driver import Slot
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.runtime.real import HOST
from forefeel.common.state.folder import LATCHED, StateFolder, state_path
from forefeel.common.state.latch import latched
from forefeel.configured_devices import ConfiguredDevice, device_of, require_released
from forefeel.daemon_settings import load_daemon
from forefeel.files import check_new_file, write_whole
from forefeel.interrupt import break_off, ends_in_order, signal_flag
from forefeel.slave.load_cell import NativeLoadCell, NativeReading
from forefeel.slave.stage import Homing
from forefeel.terminal import answer, ask, say

_POLL_NS = 5_000_000  # ns between two looks for readings, which a queue keeps meanwhile
_AVERAGE_S = 0.5  # s for which a level is read, at least
_SLOWEST_S = 30.0  # s in which a level must be read: a cell of one reading a second needs some ten
_PRIORITY = 50  # of SCHED_FIFO, the default of `realtime.priority`


class Target(NamedTuple):
    """The device, and the file that its calibration goes to. `yes`: nobody is asked."""

    config: Path
    axis: str
    out: Path
    yes: bool = False
    overwrite: bool = False
    valid_days: int = 365

    def device(self, slot: Slot) -> ConfiguredDevice:
        """Checks that the file can be written; returns the device of that slot.

        Raises:
            ConfigurationError: it can not, or there is no such device.
        """
        check_new_file(self.out, (".yaml", ".yml"), ".yaml", self.overwrite)
        if not os.access(self.out.parent, os.W_OK):
            raise ConfigurationError(f"--out {self.out}: expected a folder that exists and can be written")
        return device_of(self.config, self.axis, slot)


def run_load_cell(
    target: Target,
    weights: str | None,
    forces: str | None,
    *,
    settle_s: float = 1.0,
    residual_share: float = 0.01,
    clock: SleepingClock | None = None,
) -> None:
    """Calibrates a load cell: asks for each load, up and down, reads it, fits the line, and writes the file.

    Args:
        target: the device and the file.
        weights: in kg, with commas.
        forces: in N, in place of weights.
        settle_s: wait after a load was changed.
        residual_share: of the range, rms by which the levels may lie off the line.
        clock: of the readings.

    Raises:
        InputError: the options, the configuration or the device is not as expected, or the slave runs;
            nothing was written.
        RunError: readings invalid, unsteady or off the line, or interrupted; nothing was written.
        DeviceError: the cell failed.
    """
    loads_n = _loads_n(weights, forces)
    device = target.device("load_cell")
    require_released(target.config)
    full_scale_n, largest_n = device.settings.full_scale_n, max(map(abs, loads_n))
    if largest_n > full_scale_n:
        raise ConfigurationError(
            f"load {largest_n:.4g} N: expected at most load_cell.full_scale_n = {full_scale_n:g} N"
        )
    (low_n, high_n), sign, steps = range_of(loads_n), device.settings.sign, list[Step]()
    time = clock or MonotonicClock()
    cell: NativeLoadCell = device.driver.make(device.settings, time)
    with ends_in_order("calibration"), signal_flag(break_off), closing(cell):
        cell.open_native()
        serial = _identify(device, cell.link)
        for force_n in walk_of(loads_n):
            load = f"{force_n:.5g} N ({force_n / STANDARD_GRAVITY_M_S2:.5g} kg)" if force_n else "no load"
            request = f"Apply {load}" if force_n else "Unload the cell"
            ask_person(request, ", then press Enter", target.yes)
            level = _level(cell, time, load, settle_s)
            require_steady(level, cell.scale.newton_per_native, high_n - low_n, load)
            steps.append(Step(force_n, level))
            say(f"  {level.mean:.8g} +- {level.std:.2g}, {level.readings} readings")
    # the sign of the settings is applied after the calibration, so it is no part of the gain
    fitted = fit([Step(sign * step.force_n, step.level) for step in steps])
    require_line(fitted, high_n - low_n, residual_share)
    if flaw := cell.scale.flaw(fitted.gain_n, fitted.zero):
        raise RunError(f"{flaw}; correct load_cell (its sign, too), or the weights; nothing was written")
    calibration = LoadCellCalibration(
        format="forefeel.load_cell_calibration/1",
        **_header(device, serial, target),
        **fitted._asdict(),
        range_n=(low_n, high_n),
        points=tuple((step.level.mean, step.force_n) for step in steps),
    )
    _write(
        target.out,
        calibration,
        f"Gain        {fitted.gain_n:.6g} N per native unit, zero {fitted.zero:.6g}, {len(steps)} steps",
        f"Residual    {fitted.residual_n:.3g} N rms, {fitted.residual_n / (high_n - low_n):.2%} of the range",
        f"Hysteresis  {fitted.hysteresis_n:.3g} N, the largest difference between up and down",
    )


def _loads_n(weights: str | None, forces: str | None) -> list[float]:
    """Returns the loads in N, without 0, of the one option that is given: `weights` in kg or `forces` in N.
    ConfigurationError: none, both, a weight below 0, or as `forces_of`.
    """
    if forces is not None and weights is None:
        return forces_of(forces, 1.0, "--forces")
    if weights is None or forces is not None:
        raise ConfigurationError("--weights, --forces: expected one of them")
    loads_n = forces_of(weights, STANDARD_GRAVITY_M_S2, "--weights")
    if min(loads_n) < 0.0:
        raise ConfigurationError(f"--weights {weights}: a weight below 0; expected kg, or --forces in N")
    return loads_n


def _level(cell: NativeLoadCell, clock: SleepingClock, load: str, settle_s: float) -> Level:
    """Waits for `settle_s`, then reads the cell for 0.5 s, at least ten times; returns mean, noise and drift.
    DeviceError: fewer within 30 s. RunError: a reading is not valid.
    """
    settled_ns = clock.now_ns() + round(settle_s * 1e9)
    readings: list[NativeReading] = []
    while len(readings) < LEAST_READINGS or readings[-1].stamp_ns - readings[0].stamp_ns < _AVERAGE_S * 1e9:
        if clock.now_ns() - settled_ns > _SLOWEST_S * 1e9:
            raise DeviceError(
                f"{len(readings)} readings within {_SLOWEST_S:g} s: expected at least {LEAST_READINGS}"
            )
        read = cell.read_native(clock.now_ns())  # meanwhile, too: a cell that fails is noticed
        readings += (reading for reading in read if reading.stamp_ns > settled_ns)
        clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
    if not all(reading.valid for reading in readings):
        raise RunError(f"{load}: readings that are not valid; expected the cell within its range")
    times_s = [(reading.stamp_ns - readings[0].stamp_ns) * 1e-9 for reading in readings]
    return level_of(times_s, [reading.native for reading in readings])


def run_stage(target: Target, velocity_m_s: float, clock: SleepingClock | None = None) -> None:
    """Calibrates a stage: asks for consent, homes, travels from end to end, homes again, and writes the file.

    Raises:
        InputError: the options, the configuration or the device is not as expected; nothing moved.
        RunError: an emergency stop is latched, no consent, the travel is shorter than in the settings, or
            interrupted (the stage is stopped); nothing was written.
        DeviceError: the stage failed.
    """
    device = target.device("stage")
    settings = device.settings
    if velocity_m_s > settings.max_velocity_m_s:
        raise ConfigurationError(
            f"--velocity {velocity_m_s:g}: expected at most stage.max_velocity_m_s = "
            f"{settings.max_velocity_m_s:g}"
        )
    way_m = settings.travel_m[1] - settings.travel_m[0]
    intent = (
        f"The stage will home twice and go its whole travel, {1e3 * way_m:.4g} mm by its settings, "
        f"at {1e3 * velocity_m_s:.3g} mm/s: take out the instrument, clear the way, keep the stop at hand"
    )
    with ends_in_order("calibration"), _homed(device, target.config, intent, target.yes, clock) as stage:
        serial = stage.link.serial
        say("travelling from end to end")
        ends = stage.travel_ends(velocity_m_s)
        say("homing again")
        zero = stage.home()
    travel_m = travel_of(zero, ends, settings.native_per_m, settings.sign)
    require_travel(travel_m, settings.travel_m)
    low_mm, high_mm = (1e3 * end_m for end_m in travel_m)
    calibration = StageCalibration(
        format="forefeel.stage_calibration/1",
        **_header(device, serial, target),
        zero=zero,
        native_per_m=settings.native_per_m,
        travel_m=travel_m,
    )
    _write(
        target.out,
        calibration,
        f"Travel      {low_mm:.4g} to {high_mm:.4g} mm from the reference, {high_mm - low_mm:.4g} mm",
    )


def run_home(config: Path, axis: str, yes: bool, clock: SleepingClock | None = None) -> None:
    """Homes a stage, as it has to be after its power was off; asks for consent. Raises as `run_stage`."""
    device = device_of(config, axis, "stage")
    intent = "The stage will home: take out the instrument, clear the way, keep the stop at hand"
    with ends_in_order("homing"), _homed(device, config, intent, yes, clock, binds=False):
        say(f"{device.name}: it is homed")


@contextmanager
def _homed(
    device: ConfiguredDevice,
    config: Path,
    intent: str,
    yes: bool,
    clock: SleepingClock | None,
    binds: bool = True,
) -> Iterator[Homing]:
    """Connects a stage, not beside a running slave, asks for consent to `intent`, homes it, and gives it to
    the block, at whose end it stops. `binds`: it needs a serial number. Raises as `run_stage`.
    """
    with (
        signal_flag(break_off),
        _no_slave_beside(config),
        device.driver.make_homing(device.settings, clock or MonotonicClock()) as stage,
    ):
        _identify(device, stage.link, binds)
        require_consent(intent, yes)
        HOST.prepare_thread(_PRIORITY)  # a drive that watches our heartbeat stops when we are kept waiting
        say("homing")
        stage.home()
        yield stage


@contextmanager
def _no_slave_beside(config: Path) -> Iterator[None]:
    """Locks the slave's state folder, if there is one, while the body moves the slave's devices.
    ConfigurationError: the slave of this file runs. RunError: an emergency stop is latched.
    """
    folder = state_path(load_daemon(config), "slave", os.environ)
    if not folder.is_dir():  # no slave has ever used it
        yield
        return
    with StateFolder(folder):
        for axis, reason in latched(folder / LATCHED).items():
            raise RunError(
                f"an emergency stop is latched ({axis or 'every axis'}: {reason}); expected it to be cleared "
                "first: start the slave, then `forefeel clear`"
            )
        yield


def require_consent(intent: str, yes: bool) -> None:
    """Asks a person whether a stage may move, unless `yes`. RunError: not confirmed, or stdin ended."""
    if ask_person(intent, ". Type yes to go on", yes) not in ("yes", "y"):
        raise RunError("not confirmed; nothing moved, nothing written")


def ask_person(text: str, request: str, yes: bool) -> str:
    """Prints `text` and `request`, waits for a line on stdin, and returns it stripped, in lower case. With
    `yes` it prints `text` alone and returns "yes" at once. RunError: stdin ended.
    """
    if yes:
        say(text)
        return "yes"
    ask(f"{text}{request}")
    line = sys.stdin.readline()
    if not line:
        raise RunError(f"stdin ended at '{text}': expected a line, or --yes; nothing was written")
    return line.strip().lower()


def _identify(device: ConfiguredDevice, link: DeviceLink, binds: bool = True) -> str:
    """Prints the identity of the device; returns its serial number. DeviceSetupError: `binds`, and none."""
    if binds and not link.serial:
        raise DeviceSetupError(
            f"{device.name} on {device.where}: no serial number; expected one to bind the calibration to; "
            f"where {device.driver.name} has the setting `serial`, set it to the number on the device's label"
        )
    who = link.identity or device.driver.name
    say(f"{device.name}: {who}" + ("" if link.serial in who else f", serial {link.serial}"))
    return link.serial


def _header(device: ConfiguredDevice, serial: str, target: Target) -> dict[str, Any]:
    head = {"driver": device.driver.name, "serial": serial, "date": date.today()}
    return {**head, "valid_days": target.valid_days}


def _write(out: Path, calibration: LoadCellCalibration | StageCalibration, *lines: str) -> None:
    """Writes the file whole or not at all, and prints the lines. RunError: it can not be written."""
    write_whole(out, dump_yaml(calibration), "the calibration")
    what = f"{out}: serial {calibration.serial}, {calibration.date}, valid {calibration.valid_days} days"
    answer(*lines, what, document=lambda: calibration.model_dump(mode="json"))
