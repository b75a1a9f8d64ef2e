"""Limits how often what comes in floods is told, and counts every occurrence."""

from collections.abc import Hashable
from threading import Lock
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
E = TypeVar("E")


class EventCoalescer(Generic[K, E]):
    """Tells the first event of a key at once, then one per interval with the count. Any thread adds, one
    drains.

    Args:
        interval_ns: the least time between two of one key. Keys come from a bounded set, for each is kept.

    Attributes:
        total: occurrences of all keys.
    """

    def __init__(self, interval_ns: int) -> None:
        self.total = 0
        self._interval_ns = interval_ns
        self._lock = Lock()
        self._open: dict[K, tuple[K, E, int]] = {}
        self._told_ns: dict[K, int] = {}

    def add(self, key: K, event: E, count: int = 1) -> None:
        with self._lock:
            _, first, before = self._open.get(key, (key, event, 0))
            self._open[key] = key, first, before + count
            self.total += count

    def drain(self, now_ns: int, last: bool = False) -> list[tuple[K, E, int]]:
        """Key, first event and count since it was last told of each that is due; with `last` of all."""
        if not self._open:
            return []
        with self._lock:
            newest_ns = now_ns - self._interval_ns
            due = [key for key in self._open if last or self._told_ns.get(key, newest_ns) <= newest_ns]
            self._told_ns.update(dict.fromkeys(due, now_ns))
            return [self._open.pop(key) for key in due]
