"""The handle port: what the master needs of the thing in the surgeon's hand."""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Protocol

from forefeel.common.hardware.driver import DriverSettings, Slot
from forefeel.common.messages import Grip, SafetyState


class HandleDriverSettings(DriverSettings):
    """Base of the settings of every handle."""

    slot: ClassVar[Slot] = "handle"


class HandleReading(NamedTuple):
    """Where the handle is and what is pressed. `recording_time_s`: time in the recording that is being
    played, if one is. `estop`: the handle has a button for the emergency stop, and it is pressed.
    """

    position_m: float
    velocity_m_s: float
    deadman: bool
    gripper: Grip = Grip.CLOSED
    recording_time_s: float | None = None
    estop: bool = False


class Indication(NamedTuple):
    """What is shown to the person: the slave's state (None: no link) and where its stage is."""

    state: SafetyState | None
    stage_position_m: float | None


class Handle(Protocol):
    """Read and rendered once per haptic tick; neither call blocks.

    A handle that fails raises DeviceError from `read` and `render` until it is re-armed, and gives no force.
    """

    def open(self) -> None:
        """Raises DeviceError when the handle does not answer."""
        ...

    def close(self) -> None:
        """Takes the force away and lets go; idempotent."""
        ...

    def rearm(self) -> None:
        """After a fault of the handle: the explicit act without which it gives no force.

        Raises DeviceError while it does not answer.
        """
        ...

    @property
    def pressed_anew(self) -> bool:
        """After a fault: the handle answers again, and the person has let the deadman go and pressed it."""
        ...

    @property
    def counters(self) -> Mapping[str, int]:
        """What the handle counts of its link, by name."""
        ...

    def read(self, now_ns: int) -> HandleReading:
        """Position (m, positive inserts), velocity and buttons now. Raises DeviceError, see above."""
        ...

    def render(self, force_n: float, now_ns: int) -> float:
        """Applies a force to the hand (positive resists insertion); returns the force as applied.

        Raises DeviceError, see above.
        """
        ...

    def show(self, indication: Indication) -> None:
        """Shows the state to the person."""
        ...

    @property
    def finished(self) -> bool:
        """Whether a motion that ends by itself has ended."""
        ...

    @property
    def clutched_out_s(self) -> float:
        """Time in s that the person chose to spend with the clutch open."""
        ...
