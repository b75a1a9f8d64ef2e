"""A load cell behind Linux' industrial I/O."""

from forefeel.common.hardware.driver import Driver
from forefeel_iio.settings import IioSettings

DRIVER = Driver(
    IioSettings,
    "forefeel_iio.driver:IioLoadCell",
    "a load cell behind Linux' industrial I/O",
    emulator="forefeel_iio.emulator:EMULATION",
)
