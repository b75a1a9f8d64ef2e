"""An Inverse3 of Haply as handle, with a Verse Grip."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.haply.settings import HaplySettings

HANDLE = Driver(
    HaplySettings,
    "forefeel.devices.haply.driver:HaplyHandle",
    "Haply Inverse3 and Verse Grip, by its service",
)
