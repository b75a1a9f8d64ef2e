"""A handle that another program moves."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.servo.settings import ServoSettings

HANDLE = Driver(
    ServoSettings, "forefeel.devices.servo.driver:make_servo", "positions that `forefeel ros` hands on"
)
