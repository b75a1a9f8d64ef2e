"""The stage port: what the control loop needs of a drive."""

from math import isfinite
from types import TracebackType
from typing import Annotated, ClassVar, NamedTuple, Protocol, Self

from pydantic import Field

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.driver import DriverSettings, Slot
from forefeel.common.hardware.link import DeviceLink

CARRIED_S = 0.020  # s by which a reading is carried on with its velocity


Travel = tuple[float, float]
"""Lowest and highest position in m."""


class StageDriverSettings(DriverSettings):
    """Base of the settings of every stage. `lag_s`: the most by which its readback is late to its setpoint; a
    readback that this does not explain is a fault. Of a simulated stage its bandwidth counts instead.
    """

    slot: ClassVar[Slot] = "stage"
    lag_s: Annotated[float, Field(gt=0, le=0.3)] = 0.1

    @property
    def travel(self) -> Travel | None:
        """Ends between which the stage may go; None: the axis' own limits are all there is."""
        return getattr(self, "travel_m", None)


class StageReading(NamedTuple):
    """Readback of the drive: position of the motor's encoder in m, velocity in m/s."""

    position_m: float
    velocity_m_s: float

    def carried_on(self, stamp_ns: int, now_ns: int) -> "StageReading":
        """The reading of `stamp_ns`, moved on by its velocity to now, for at most 20 ms."""
        age_s = min(max(now_ns - stamp_ns, 0) * 1e-9, CARRIED_S)
        return StageReading(self.position_m + self.velocity_m_s * age_s, self.velocity_m_s)


def require_finite(position_m: float, velocity_m_s: float) -> None:
    """Raises DeviceError for a setpoint that is no number."""
    if not (isfinite(position_m) and isfinite(velocity_m_s)):
        raise DeviceError(f"setpoint = ({position_m} m, {velocity_m_s} m/s): expected finite numbers")


class Stage(Protocol):
    """Follows a stream of setpoints within its limits, and comes to rest by itself when the stream ends.
    Every method raises `DeviceError` when the device fails or is not open.
    """

    def open(self) -> None:
        """Connects and makes the drive ready; it holds its position."""
        ...

    def close(self) -> None: ...

    def rearm(self) -> None:
        """Makes the drive ready after a fault, without which it stays failed; it holds."""
        ...

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        """Sets the setpoint with its velocity; returns the position as applied within the drive's travel."""
        ...

    def hold(self, now_ns: int) -> None:
        """Decelerates to rest and holds until the next command; may be called from any thread."""
        ...

    def read(self, now_ns: int) -> StageReading:
        """The readback at `now_ns`; a drive that is read more seldom carries it on for at most 20 ms."""
        ...


class Homing(Protocol):
    """A stage while it is calibrated: it need not know where it is, and its calibration is not looked at.
    Use: `with homing:`; whatever ends the block, the stage is told to stop and let go.

    `home` and `travel_ends` move it, wait, and leave it at rest; they raise `DeviceError` when the device
    fails or does not come to an end in the time that the distance takes.

    Attributes:
        link: its `serial` is what the calibration is bound to.
    """

    link: DeviceLink

    def __enter__(self) -> Self:
        """Connects and identifies; nothing moves."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def home(self) -> float:
        """Finds the reference anew; returns its position, in native units of the count from now on."""
        ...

    def travel_ends(self, velocity_m_s: float) -> tuple[float, float]:
        """Goes from one end of the travel to the other at no more than that speed; returns both positions in
        native units of the count that holds, in any order.
        """
        ...
