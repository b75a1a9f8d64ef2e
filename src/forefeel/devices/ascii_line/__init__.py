"""A load cell that prints a number a line."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.ascii_line.settings import AsciiLineSettings

LOAD_CELL = Driver(
    AsciiLineSettings,
    "forefeel.devices.ascii_line.driver:AsciiLineLoadCell",
    "a number a line (Loadstar, HX711), serial",
    emulator="forefeel.devices.ascii_line.emulator:EMULATION",
)
