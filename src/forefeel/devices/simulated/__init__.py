"""Devices without hardware: of the simulated world, of a recording, and handles whose motion is given."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.simulated import settings as s

STAGE = Driver(
    s.SimulatedStageSettings,
    "forefeel.devices.simulated.driver:SimulatedStage",
    "the stage of the simulated world",
    in_world=True,
)
GRIPPER = Driver(
    s.SimulatedGripperSettings,
    "forefeel.devices.simulated.driver:SimulatedGripper",
    "the fixture of the simulated world",
    in_world=True,
)
LOAD_CELL = Driver(
    s.SimulatedLoadCellSettings,
    "forefeel.devices.simulated.driver:SimulatedLoadCell",
    "the load cell of the simulated world",
    in_world=True,
)
RECORDED_LOAD_CELL = Driver(
    s.RecordedLoadCellSettings,
    "forefeel.devices.simulated.recorded:make_load_cell",
    "the force of a recording",
)
OPERATOR = Driver(
    s.OperatorSettings, "forefeel.devices.simulated.operator:make_operator", "a synthetic operator"
)
RECORDED_HANDLE = Driver(
    s.RecordedHandleSettings,
    "forefeel.devices.simulated.playback:make_recorded",
    "plays the motion of a recording",
)
