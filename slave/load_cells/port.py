"""The load-cell port: what the control loop needs of a force sensor."""

from typing import NamedTuple, Protocol


class LoadCellReading(NamedTuple):
    """Force in N, the raw counts it comes from, and whether to believe it (in range, no device error)."""

    force_n: float
    raw_counts: int
    valid: bool


class LoadCell(Protocol):
    """Gives the newest force without waiting.

    Every method raises `DeviceError` when the device fails or is not open.
    """

    def open(self) -> None:
        """Connects."""
        ...

    def close(self) -> None:
        """Lets the device go; idempotent."""
        ...

    def read(self, now_ns: int, recording_time_s: float | None) -> LoadCellReading:
        """The newest force at `now_ns`.

        `recording_time_s` belongs to the command that the stage is executing; a physical cell ignores it, a
        recorded one answers with the force of that time.
        """
        ...
