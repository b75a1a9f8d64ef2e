"""The only reader of the system's time."""

import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic nanoseconds of one host."""

    def now_ns(self) -> int:
        """The stamp now; never goes back. Only differences, on one host, have a meaning."""
        ...


class MonotonicClock:
    """The host's CLOCK_MONOTONIC."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary start."""
        return time.monotonic_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleeps to an absolute deadline; returns at once when it is past. The interpreter lock is free
        meanwhile.
        """
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)


class VirtualClock:
    """A clock that stands until it is set."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """The stamp that was set last."""
        return self._now_ns

    def set_ns(self, now_ns: int) -> None:
        """Moves the clock forward.

        Raises:
            ValueError: the stamp goes back.
        """
        if now_ns < self._now_ns:
            raise ValueError(f"time goes back: {now_ns} < {self._now_ns}")
        self._now_ns = now_ns
