"""A CiA 402 drive over CANopen."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.cia402.settings import Cia402Settings

STAGE = Driver(
    Cia402Settings,
    "forefeel.devices.cia402.driver:Cia402Stage",
    "CiA 402 drive, CANopen",
    homing="forefeel.devices.cia402.homing:Cia402Homing",
    emulator="forefeel.devices.cia402.emulator:EMULATION",
)
