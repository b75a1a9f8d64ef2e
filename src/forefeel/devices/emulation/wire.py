"""An emulated device as bytes in and out, and the time that they take on the wire to its host. Pure."""

from collections import deque
from collections.abc import Sequence
from typing import Protocol

_BITS = 10  # start, eight data bits, stop


class EmulatedDevice(Protocol):
    """Device as bytes in and out; time is an argument."""

    @property
    def faults(self) -> Sequence[str]: ...

    def receive(self, data: bytes, t_s: float) -> None:
        """Takes bytes of the host that have arrived at that time."""
        ...

    def advance(self, t_s: float) -> bytes:
        """Advances the device to that time; the bytes that it sends now."""
        ...

    def provoke(self, fault: str) -> None:
        """Begins one of `faults`, of the device itself: `stuck`, `drive_fault`; `free` ends some."""
        ...


class Wire:
    """One direction: bytes take ten bits each at the baud rate, one after the other."""

    def __init__(self, baud: int) -> None:
        self.byte_s = _BITS / baud
        self._free_s = 0.0
        self._under_way: deque[tuple[float, bytes]] = deque()

    def send(self, data: bytes, t_s: float) -> None:
        """Puts a chunk (a frame, a line) on the wire."""
        if data:
            self.carry(data, t_s)

    def carry(self, data: bytes, t_s: float, wait_s: float = 0.0) -> None:
        """Puts bytes on the wire `wait_s` after those before them have arrived."""
        self._free_s = max(self._free_s, t_s) + wait_s + len(data) * self.byte_s
        self._under_way.append((self._free_s, data))

    def arrived(self, t_s: float) -> bytes:
        """Takes the bytes off the wire that have arrived by then."""
        data = bytearray()
        while self._under_way and self._under_way[0][0] <= t_s:
            data += self._under_way.popleft()[1]
        return bytes(data)

    @property
    def next_s(self) -> float | None:
        """Time at which the next part arrives; None when nothing is under way."""
        return self._under_way[0][0] if self._under_way else None
