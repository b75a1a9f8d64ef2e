"""The runtime port: loops, tasks, timers and faults."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, TypeVar

from forefeel.common.clock import Clock
from forefeel.common.lateness import Lateness
from forefeel.common.transport.port import Timers

T = TypeVar("T")
Tick = Callable[[int], None]
"""Called with the stamp now in ns of the runtime's clock."""
Pause = Callable[[], object]


class Runtime(Protocol):
    """Runs what a daemon registers before the start, until it is stopped."""

    @property
    def clock(self) -> Clock:
        """The clock that the ticks are driven by."""
        ...

    @property
    def timers(self) -> Timers:
        """Single actions at a stamp of that clock."""
        ...

    def loop(self, name: str, period_ns: int, tick: Tick) -> Lateness:
        """Registers a hard-paced loop on absolute deadlines, in its own thread; returns its lateness."""
        ...

    def task(self, name: str, period_ns: int, tick: Tick) -> None:
        """Registers a soft-paced periodic task, on asyncio."""
        ...

    def compute(self, work: Callable[[Pause], T]) -> "Future[T]":
        """Runs `work`, which may take long, in a thread of its own, in virtual time at once; returns the
        future of its result. `work` is given a function to call between pieces of at most some 0.1 ms.
        """
        ...

    def fault(self, error: BaseException) -> None:
        """Reports a fault of any thread: the safety reaction runs now, the daemon ends with the error."""
        ...

    def on_fault(self, reaction: Callable[[BaseException], None]) -> None:
        """Adds a reaction to faults; it must not block and must not raise."""
        ...

    @property
    def scheduling(self) -> str:
        """Scheduling that the loops got from the operating system, in plain words."""
        ...
