"""A voice coil with an encoder as handle."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.coil.settings import CoilSettings

HANDLE = Driver(
    CoilSettings,
    "forefeel.devices.coil.driver:CoilHandle",
    "voice coil and encoder behind a microcontroller, serial",
    emulator="forefeel.devices.coil.emulator:EMULATION",
)
