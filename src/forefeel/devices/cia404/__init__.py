"""A CiA 404 force transducer over CANopen."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.cia404.settings import Cia404Settings

LOAD_CELL = Driver(
    Cia404Settings,
    "forefeel.devices.cia404.driver:Cia404LoadCell",
    "CiA 404 force transducer, CANopen",
    emulator="forefeel.devices.cia404.emulator:EMULATION",
)
