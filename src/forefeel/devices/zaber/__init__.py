"""A Zaber stage, ASCII protocol."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.zaber.settings import ZaberSettings

STAGE = Driver(
    ZaberSettings,
    "forefeel.devices.zaber.driver:ZaberStage",
    "Zaber stage, ASCII protocol, serial",
    homing="forefeel.devices.zaber.homing:ZaberHoming",
    emulator="forefeel.devices.zaber.emulator:EMULATION",
)
