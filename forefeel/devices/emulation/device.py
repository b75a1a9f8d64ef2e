"""What every emulated device is: bytes in, bytes out, time as an argument. Pure."""

from collections.abc import Sequence
from typing import Protocol


class EmulatedDevice(Protocol):
    """A device behind a byte stream."""

    @property
    def faults(self) -> Sequence[str]:
        """The faults that `provoke` takes."""
        ...

    def receive(self, data: bytes, t_s: float) -> None:
        """Takes bytes of the host that have arrived at that time."""
        ...

    def advance(self, t_s: float) -> bytes:
        """Lets the device live up to that time; the bytes that it sends now."""
        ...

    def provoke(self, fault: str) -> None:
        """Begins a fault of the device itself: `stuck`, `overrange`, `drive_fault`; `free` ends some.

        Raises:
            ConfigurationError: it has no such fault.
        """
        ...
