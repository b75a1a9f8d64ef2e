"""The two ways in which a foreign thread hands over: the newest value, or a bounded queue."""

from collections import deque
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestValue(Generic[T]):
    """A slot that keeps the newest value; one that was never taken is counted as superseded."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._value: T | None = None
        self.superseded = 0

    def put(self, value: T) -> None:
        with self._lock:
            self.superseded += self._value is not None
            self._value = value

    def take(self) -> T | None:
        """The newest value, once; None when there is no new one."""
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
        """Appends; never blocks."""
        self.dropped += len(self._entries) == self._entries.maxlen
        self._entries.append(value)

    def drain(self) -> list[T]:
        """Everything that is in the queue now, oldest first."""
        batch: list[T] = []
        while self._entries:
            batch.append(self._entries.popleft())
        return batch
