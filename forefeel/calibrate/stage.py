"""`forefeel calibrate stage`: home twice, the way from end to end; asked before it moves."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from forefeel.calibrate.measuring import require_travel, travel_of
from forefeel.calibrate.procedure import about, ask_person, introduce, require_options, write
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
from forefeel.probe.configured import device_of
from forefeel.terminal import say

_PRIORITY = 50  # of SCHED_FIFO, the default of `realtime.priority`


@dataclass(frozen=True, slots=True)
class StageCalibrationOptions:
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
    require_options(
        options.out,
        options.overwrite,
        ("--velocity", options.velocity_m_s, 1e-4, 0.05, ""),
        ("--max-repeatability", options.repeatability_m, 1e-9, 0.01, ""),
        ("--valid-days", options.valid_days, 1, 3650, ""),
    )
    device = device_of(options.config, options.axis, "stage")
    settings = device.settings
    if options.velocity_m_s > settings.max_velocity_m_s:
        raise ConfigurationError(
            f"--velocity {options.velocity_m_s:g}: expected at most stage.max_velocity_m_s = "
            f"{settings.max_velocity_m_s:g}"
        )
    with (
        heeded(lambda: None),
        breakable(lambda: "calibration interrupted; the stage was stopped, nothing was written"),
        no_slave_beside(options.config),
        device.driver.make_homing(settings, clock or MonotonicClock()) as stage,
    ):
        serial = introduce(device, stage.link)
        if ask_person(_intent(options, settings), ". Type yes to go on", options.yes) not in ("yes", "y"):
            raise RunError("not confirmed; nothing moved, nothing written")
        HOST.prepare_thread(_PRIORITY)  # a drive that watches our heartbeat stops when we are kept waiting
        say("homing")
        stage.home()
        say("travelling from end to end")
        ends = stage.travel_ends(options.velocity_m_s)
        say("homing again")
        again = stage.home()
    travel = travel_of(again.native, ends, again.shift, settings.native_per_m, settings.sign)
    require_travel(travel, settings.travel_m, options.repeatability_m)
    off_m, (low_mm, high_mm) = travel.repeatability_m, (1e3 * end_m for end_m in travel.ends_m)
    write(
        options.out,
        StageCalibration(
            **about(device, serial, today or date.today(), options.valid_days),
            zero=again.native,
            native_per_m=settings.native_per_m,
            travel_m=travel.ends_m,
            repeatability_m=off_m,
        ),
        f"Travel      {low_mm:.4g} to {high_mm:.4g} mm from the reference, {high_mm - low_mm:.4g} mm",
        "Home        "
        + ("not told by the device" if off_m is None else f"found again within {1e6 * off_m:.3g} um"),
    )


def _intent(options: StageCalibrationOptions, settings: ZaberSettings | Cia402Settings) -> str:
    how = ""
    if isinstance(settings, Cia402Settings):
        homing = settings.homing
        how = f" (method {homing.method}, at {1e3 * homing.search_velocity_m_s:g} mm/s)"
        if homing.method in HERE:
            how = f" (nothing moves for it: where it stands is taken for x = {1e3 * homing.home_m:g} mm)"
    length_m = settings.travel_m[1] - settings.travel_m[0]
    return (
        f"The stage will home twice{how} and go its whole travel, {1e3 * length_m:.4g} mm by its settings, "
        f"at {1e3 * options.velocity_m_s:.3g} mm/s: take out the instrument, clear the way, keep the stop at "
        "hand"
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
