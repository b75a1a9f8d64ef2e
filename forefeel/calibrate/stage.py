"""`forefeel calibrate stage`: home twice, the way from end to end; asked before it moves."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from forefeel.calibrate.load_cell import introduced, require_serial
from forefeel.calibrate.measuring import Travel, require_travel, travel_of
from forefeel.calibrate.prompt import Prompt
from forefeel.calibrate.target import check_target, write_calibration
from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.hardware.calibration import StageCalibration
from forefeel.common.runtime.real import HOST
from forefeel.common.state.folder import LATCHED, StateFolder, state_path
from forefeel.common.state.latch import latched
from forefeel.daemon_settings import load_daemon
from forefeel.devices.cia402.protocol import HERE
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.interrupt import breakable, heeded
from forefeel.probe.configured import ConfiguredDevice, device_of
from forefeel.slave.stage import Homing
from forefeel.terminal import answer, say

_PRIORITY = 50  # of SCHED_FIFO, the default of `realtime.priority`


@dataclass(frozen=True, slots=True)
class StageCalibrationOptions:
    """What the user asked for."""

    config: Path
    axis: str
    out: Path
    yes: bool = False
    overwrite: bool = False
    velocity_m_s: float = 0.005
    repeatability_m: float = 50e-6
    valid_days: int = 365


def run_stage(
    options: StageCalibrationOptions, clock: SleepingClock | None = None, today: date | None = None
) -> None:
    """Calibrates and writes the file.

    Raises:
        InputError: the options, the configuration or the device is not as expected; nothing moved.
        RunError: an emergency stop is latched, it was refused for what was found, or interrupted (the stage
            is stopped); nothing was written.
        DeviceError: the stage failed.
    """
    _check(options)
    device = device_of(options.config, options.axis, "stage")
    settings = device.settings
    if options.velocity_m_s > settings.max_velocity_m_s:
        raise ConfigurationError(
            f"--velocity {options.velocity_m_s:g}: expected at most stage.max_velocity_m_s = "
            f"{settings.max_velocity_m_s:g}"
        )
    person = Prompt(options.yes)
    with (
        heeded(lambda: None),
        breakable(lambda: "calibration interrupted; the stage was stopped, nothing was written"),
        no_slave_beside(options.config),
        device.driver.make_homing(settings, clock or MonotonicClock()) as stage,
    ):
        serial = require_serial(stage.link.serial, device)
        say(introduced(device, stage.link))
        person.agree(_intent(options, settings))
        HOST.prepare_thread(_PRIORITY)  # a drive that watches our heartbeat stops when we are kept waiting
        zero, travel = _moved(stage, settings, options)
    require_travel(travel, settings.travel_m, options.repeatability_m)
    _write(options, device, serial, zero, travel, today or date.today())


def _check(options: StageCalibrationOptions) -> None:
    check_target(options.out, options.overwrite)
    for option, value, low, high in (
        ("--velocity", options.velocity_m_s, 1e-4, 0.05),
        ("--max-repeatability", options.repeatability_m, 1e-9, 0.01),
        ("--valid-days", options.valid_days, 1, 3650),
    ):
        if not low <= value <= high:
            raise ConfigurationError(f"{option} {value:g}: expected {low:g} to {high:g}")


def _intent(options: StageCalibrationOptions, settings: ZaberSettings | Cia402Settings) -> str:
    length_m = settings.travel_m[1] - settings.travel_m[0]
    return (
        f"The stage will home twice{_in_words(settings)} and go its whole travel, {1e3 * length_m:.4g} mm by "
        f"its settings, at {1e3 * options.velocity_m_s:.3g} mm/s: take out the instrument, clear the way, "
        "keep the stop at hand"
    )


def _in_words(settings: ZaberSettings | Cia402Settings) -> str:
    if not isinstance(settings, Cia402Settings):
        return ""
    homing, home_mm = settings.homing, 1e3 * settings.homing.home_m
    if homing.method in HERE:
        return f" (nothing moves for it: where it stands is taken for x = {home_mm:g} mm)"
    return f" (method {homing.method}, at {1e3 * homing.search_velocity_m_s:g} mm/s)"


def _moved(
    stage: Homing, settings: ZaberSettings | Cia402Settings, options: StageCalibrationOptions
) -> tuple[float, Travel]:
    """Zero in native units and the travel in m."""
    say("homing")
    stage.home()
    say("travelling from end to end")
    ends = stage.travel_ends(options.velocity_m_s)
    say("homing again")
    again = stage.home()
    return again.native, travel_of(again.native, ends, again.shift, settings.native_per_m, settings.sign)


def _write(
    options: StageCalibrationOptions,
    device: ConfiguredDevice,
    serial: str,
    zero: float,
    travel: Travel,
    today: date,
) -> None:
    calibration = StageCalibration(
        format="forefeel.stage_calibration/1",
        driver=device.driver.name,
        serial=serial,
        date=today,
        valid_days=options.valid_days,
        zero=zero,
        native_per_m=device.settings.native_per_m,
        travel_m=travel.ends_m,
        repeatability_m=travel.repeatability_m,
    )
    write_calibration(options.out, calibration)
    low_mm, high_mm = (1e3 * end_m for end_m in travel.ends_m)
    again = travel.repeatability_m
    home = "not told by the device" if again is None else f"found again within {1e6 * again:.3g} um"
    answer(
        f"Travel      {low_mm:.4g} to {high_mm:.4g} mm from the reference, {high_mm - low_mm:.4g} mm",
        f"Home        {home}",
        f"{options.out}: serial {serial}, {today}, valid {options.valid_days} days",
        document=lambda: calibration.model_dump(mode="json"),
    )


@contextmanager
def no_slave_beside(config: Path) -> Iterator[None]:
    """Holds the slave's state folder while the body moves its devices.

    Raises:
        ConfigurationError: the slave of this file runs.
        RunError: an emergency stop is latched.
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
