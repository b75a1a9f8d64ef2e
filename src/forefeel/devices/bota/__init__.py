"""A Bota six-axis force sensor."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.bota.settings import BotaSettings

LOAD_CELL = Driver(
    BotaSettings,
    "forefeel.devices.bota.driver:BotaSerialLoadCell",
    "Bota six-axis cell, binary frames, serial",
    emulator="forefeel.devices.bota.emulator:EMULATION",
)
