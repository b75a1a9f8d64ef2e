"""The gripper port: what the control loop needs of the fixture on the stage."""

from typing import ClassVar, Protocol

from forefeel.common.hardware.driver import DriverSettings, Slot
from forefeel.common.messages import Grip


class GripperDriverSettings(DriverSettings):
    slot: ClassVar[Slot] = "gripper"


class Gripper(Protocol):
    """Holds or releases the instrument. Methods raise `DeviceError` on failure, or when it is not open."""

    def open(self) -> None:
        """Connects; the grip stays as it is. Not the opening of the jaws."""
        ...

    def close(self) -> None:
        """Lets the device go, the grip stays as it is; idempotent."""
        ...

    def set(self, grip: Grip, now_ns: int) -> Grip:
        """Asks for a grip; returns the one that holds now."""
        ...
