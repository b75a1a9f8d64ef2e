"""The only reader of the system's time for what is commanded, predicted, recorded or judged."""

import ctypes
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import ClassVar, Protocol

_C_KEEPING_THE_LOCK = ctypes.PyDLL(None)  # its functions run with the interpreter lock held


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class Clock(Protocol):
    """Monotonic nanoseconds of one host."""

    def now_ns(self) -> int:
        """The stamp now; never goes back. Only differences, on one host, have a meaning."""
        ...


class SleepingClock(Clock, Protocol):
    """A clock that can be waited for."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleeps until that stamp."""
        ...


class MonotonicClock:
    """The host's CLOCK_MONOTONIC.

    Attributes:
        read_ns: the source of every such clock in this process. A trial of what a wrong clock does puts
            another source in its place; the host's own clock is never set.
    """

    read_ns: ClassVar[Callable[[], int]] = staticmethod(time.monotonic_ns)

    def now_ns(self) -> int:
        return MonotonicClock.read_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleeps to an absolute deadline, the interpreter lock free; returns at once when it is past."""
        remaining_ns = deadline_ns - MonotonicClock.read_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)

    def hold_ns(self, duration_ns: int) -> None:
        """Sleeps for less than 1 s with the interpreter lock held: no other thread of the process runs."""
        _C_KEEPING_THE_LOCK.nanosleep(ctypes.byref(_Timespec(0, duration_ns)), None)


class VirtualClock:
    """A clock that stands until it is set."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def set_ns(self, now_ns: int) -> None:
        """Moves the clock forward.

        Raises:
            ValueError: the stamp goes back.
        """
        if now_ns < self._now_ns:
            raise ValueError(f"time goes back: {now_ns} < {self._now_ns}")
        self._now_ns = now_ns


def now_utc() -> datetime:
    """The calendar's time, which may jump: for what expires on a date, never for control."""
    return datetime.now(UTC)


def utc_text() -> str:
    """The wall clock as ISO 8601 with microseconds, for a log: it may be wrong, and step."""
    return f"{now_utc():%Y-%m-%dT%H:%M:%S.%fZ}"
