"""What every emulated device is: bytes in, bytes out, time as an argument. Pure."""

from collections.abc import Sequence
from typing import Protocol


class EmulatedDevice(Protocol):
    """A device behind a byte stream."""

    @property
    def faults(self) -> Sequence[str]:
        """What `provoke` takes."""
        ...

    def receive(self, data: bytes, t_s: float) -> None:
        """Bytes of the host that have arrived at that time."""
        ...

    def advance(self, t_s: float) -> bytes:
        """Lives up to that time; what it sends now."""
        ...

    def provoke(self, fault: str) -> None:
        """Begins a fault of the device itself: `stuck`, `overrange`, `drive_fault`; `free` ends some.

        Raises:
            ConfigurationError: it has no such fault.
        """
        ...
