"""File descriptors of this process: how many more may be opened, and some for what must always be written."""

import fcntl
import os
import resource
import threading
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from itertools import count, islice

_RESERVED = 64
"""Descriptors kept below the hard limit. A flight record takes fewer than ten."""
_NOFILE = resource.RLIMIT_NOFILE


class Descriptors:
    """The soft limit of the process, which the kernel compares with the number of each new descriptor."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._soft = 0
        self._reserved: list[int] = []

    def used(self) -> set[int]:
        """Those that are open. Where no further one can be opened to list them, each number is tried."""
        numbers: Iterable[int]
        try:
            numbers = [int(name) for name in os.listdir("/proc/self/fd")]  # noqa: PTH208 - numbers, not paths
        except OSError:
            numbers = range(resource.getrlimit(_NOFILE)[0] + _RESERVED)
        return set(filter(_is_open, numbers))  # without that of the listing, which is closed

    def allow(self, more: int, used: Collection[int]) -> None:
        """Lets the process open at most that many beside those in use, and at least one of them, as far as
        the reserve is left. A number may be taken though nothing is open there, by a call that waits.
        """
        free = (number for number in count() if number not in used)
        with self._lock:
            self._soft = min(next(islice(free, more, None)), _most())
            self._apply()
            while more and self._soft < _most() and not _can_open():
                self._soft += 1
                self._apply()

    def allow_all(self) -> None:
        """As many as the hard limit gives, less the reserve."""
        with self._lock:
            self._soft = _most()
            self._apply()

    @contextmanager
    def reserve(self, more: int = _RESERVED) -> Iterator[None]:
        """Raises the limit while it is entered: the body opens files although all others are taken.

        Any thread may enter it. The others may open as many meanwhile, so the body is short.
        """
        with self._lock:
            self._soft = self._soft or _most()
            self._reserved.append(more)
            self._apply()
        try:
            yield
        finally:
            with self._lock:
                self._reserved.remove(more)
                self._apply()

    def _apply(self) -> None:
        resource.setrlimit(
            _NOFILE, (self._soft + max(self._reserved, default=0), resource.getrlimit(_NOFILE)[1])
        )


def _most() -> int:
    """What leaves the reserve. The soft limit of the start says nothing: it may be that of a parent which
    bounds strangers, too.
    """
    return resource.getrlimit(_NOFILE)[1] - _RESERVED


def _can_open() -> bool:
    try:
        os.close(os.eventfd(0))
    except OSError:
        return False
    return True


def _is_open(descriptor: int) -> bool:
    try:
        fcntl.fcntl(descriptor, fcntl.F_GETFD)
    except OSError:
        return False
    return True


DESCRIPTORS = Descriptors()
"""Of this process: its limit is one, too."""
