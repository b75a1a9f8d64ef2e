"""The stage port: what the control loop needs of a drive."""

from typing import NamedTuple, Protocol


class StageReading(NamedTuple):
    """What the drive reads back: position of the motor's encoder in m, velocity in m/s."""

    position_m: float
    velocity_m_s: float


class Stage(Protocol):
    """Follows a stream of setpoints within its own limits, and comes to rest by itself when the stream ends.

    Every method raises `DeviceError` when the device fails or is not open.
    """

    def open(self) -> None:
        """Connects and makes the drive ready; it holds its position."""
        ...

    def close(self) -> None:
        """Lets the device go, at rest; idempotent."""
        ...

    def rearm(self) -> None:
        """After a fault of the drive: the explicit act without which it stays failed; it holds."""
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
