"""Handover from one thread to another: the newest value, a bounded queue, or values by their command."""

from collections import deque
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestValue(Generic[T]):
    """A slot that keeps the newest value."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._value: T | None = None

    def put(self, value: T) -> None:
        with self._lock:
            self._value = value

    def take(self) -> T | None:
        """Removes and returns the newest value; None where none was put since the last call."""
        if self._value is None:
            return None
        with self._lock:
            value, self._value = self._value, None
        return value


class BoundedQueue(Generic[T]):
    """A queue that drops its oldest entry, counted, when it is full; drained in batches."""

    def __init__(self, capacity: int) -> None:
        self._entries: deque[T] = deque(maxlen=capacity)
        self.dropped = 0

    def put(self, value: T) -> None:
        self.dropped += len(self._entries) == self._entries.maxlen
        self._entries.append(value)

    def drain(self) -> list[T]:
        batch: list[T] = []
        while self._entries:
            batch.append(self._entries.popleft())
        return batch


_COMMANDS = 8192
"""8.2 s of commands at 1 kHz, four times the longest round trip of a session."""
_TICK_NS = 1_000_000
ANSWERED_NS = 5_000_000
"""A motion is that of the last command before it, unless it is older than this."""


class CommandRing(Generic[T]):
    """Values of the last 8192 commands, by their stamps in ns. One thread puts while another gets."""

    def __init__(self) -> None:
        self._entries: list[tuple[int, T] | None] = [None] * _COMMANDS

    def put(self, stamp_ns: int, value: T) -> None:
        self._entries[stamp_ns // _TICK_NS % _COMMANDS] = stamp_ns, value

    def get(self, stamp_ns: int) -> T | None:
        """Value put with the newest stamp up to `stamp_ns`; None where that is 5 ms or more before, or
        unknown.
        """
        tick = stamp_ns // _TICK_NS
        for place in range(tick, tick - ANSWERED_NS // _TICK_NS - 1, -1):
            entry = self._entries[place % _COMMANDS]
            if entry is not None and 0 <= stamp_ns - entry[0] < ANSWERED_NS:
                return entry[1]
        return None
