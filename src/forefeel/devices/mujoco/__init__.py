"""Worlds by MuJoCo: any model of its own (MJCF), and a guidewire in a planar vessel."""

from forefeel.common.hardware.driver import Driver
from forefeel.devices.mujoco import settings as s

MODEL = Driver(s.MujocoSettings, "forefeel.devices.mujoco.model:MujocoModel", "a MuJoCo model (MJCF)")
VESSEL = Driver(
    s.GuidewireSettings, "forefeel.devices.mujoco.vessel:make_vessel", "a guidewire in a vessel, by MuJoCo"
)
