"""What the calibrations share: the person who is asked, the device that answers, the dated file."""

import os
import sys
from pathlib import Path
from typing import Any

from forefeel.common.config import dump_yaml
from forefeel.common.errors import ConfigurationError, DeviceSetupError, RunError
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.link import DeviceLink
from forefeel.files import check_new_file, write_whole
from forefeel.probe.configured import ConfiguredDevice
from forefeel.terminal import answer, ask, say


def ask_person(text: str, request: str, yes: bool) -> str:
    """Says `text`, and waits for the line that it requests on stdin; with `yes` it waits for nothing.

    Raises:
        RunError: stdin ended.
    """
    if yes:
        say(text)
        return "yes"
    ask(f"{text}{request}")
    line = sys.stdin.readline()
    if not line:
        raise RunError(f"stdin ended at '{text}': expected a line, or --yes; nothing was written")
    return line.strip().lower()


def require_options(out: Path, overwrite: bool, *ranges: tuple[str, float, float, float, str]) -> None:
    """Refuses a file that can not be written, and numbers (option, value, low, high, unit) out of range.

    Raises:
        ConfigurationError: which one, and what was expected.
    """
    check_new_file(out, (".yaml", ".yml"), ".yaml", overwrite)
    if not out.parent.is_dir() or not os.access(out.parent, os.W_OK):
        raise ConfigurationError(f"--out {out}: expected a folder that exists and can be written")
    for option, value, low, high, unit in ranges:
        if not low <= value <= high:
            raise ConfigurationError(f"{option} {value:g}: expected {low:g} to {high:g}{unit}")


def introduce(device: ConfiguredDevice, link: DeviceLink) -> str:
    """Says who has answered; the serial number that the calibration is bound to.

    Raises:
        DeviceSetupError: the device has none.
    """
    if not link.serial:
        slot, settable = device.driver.slot, hasattr(device.settings, "serial")
        raise DeviceSetupError(
            f"{device.name} on {device.where}: no serial number; expected one to bind the calibration to"
            + (f": write {slot}.serial, the number on its label" if settable else "")
        )
    who = link.identity or device.driver.name
    say(f"{device.name}: {who}" + ("" if link.serial in who else f", serial {link.serial}"))
    return link.serial


def write(out: Path, calibration: LoadCellCalibration | StageCalibration, *lines: str) -> None:
    """Writes the file whole or not at all, and answers the lines.

    Raises:
        RunError: it can not be written.
    """
    write_whole(out, dump_yaml(calibration), "the calibration")
    what = f"{out}: serial {calibration.serial}, {calibration.date}, valid {calibration.valid_days} days"
    answer(*lines, what, document=lambda: calibration.model_dump(mode="json"))


def about(device: ConfiguredDevice, serial: str, today: object, valid_days: int) -> dict[str, Any]:
    form = f"forefeel.{device.driver.slot}_calibration/1"
    head = {"driver": device.driver.name, "serial": serial, "date": today}
    return {"format": form, **head, "valid_days": valid_days}
