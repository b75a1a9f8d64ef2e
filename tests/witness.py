"""Tests of real time: safety is always asserted, timeliness only while the machine was on time, too.

A thread of the test notes how late it is woken. An assertion of timeliness that fails while that thread was
late by half of the assertion's slack or more says nothing of the product. Then it is not judged, and the end
of the run says so; too many of those fail the run.
"""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

PRIORITY = 30
"""Of SCHED_FIFO, where it is granted: that of the threads of a daemon that are not its loop."""
WATCHDOG_S = 0.060
"""Of the slave. What needs a session without a stop has this slack: a machine that stands still ends it."""
_DEVICE_PRIORITY = 60
"""Of SCHED_RR: that of `forefeel emulate`, above the loops of daemons, which other tests run meanwhile."""
_STEP_S = 0.005


class Witness:
    """How late a thread was that does nothing but sleep. Attribute `not_judged`: why, of each such assertion.

    Args:
        priority: of SCHED_FIFO, where it is granted; 0: the scheduling of who starts it.
    """

    def __init__(self, priority: int = 0) -> None:
        self.asked = False
        self.not_judged: list[str] = []
        self._latest_s, self._due_s = 0.0, time.monotonic()
        self._priority, self._ended = priority, False
        self._thread = threading.Thread(target=self._run, name="witness")

    def __enter__(self) -> Self:
        self._due_s = time.monotonic()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()

    @property
    def late_s(self) -> float:
        """The most so far, also when it still waits to be woken."""
        return max(self._latest_s, time.monotonic() - self._due_s)

    @contextmanager
    def timely(self, slack_s: float) -> Iterator[None]:
        """For assertions of timeliness only: nothing inside may be needed after.

        Args:
            slack_s: how much later than on a machine that is never late they still hold.
        """
        self.asked = True
        try:
            yield
        except AssertionError as error:
            late_s = self.late_s
            if late_s < slack_s / 2:
                raise
            why = (str(error).splitlines() or ["an assertion"])[0]
            self.not_judged.append(f"the machine was late by {1e3 * late_s:.0f} ms: {why}")

    def _run(self) -> None:
        if self._priority:
            with suppress(OSError):  # not granted: the daemons do not have it either
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
        while not self._ended:
            self._due_s = time.monotonic() + _STEP_S
            time.sleep(_STEP_S)
            self._latest_s = max(self._latest_s, time.monotonic() - self._due_s)


def go_ahead() -> None:
    """Lets this process, and what it starts, keep time as a real device does, where it is granted.

    All of its threads: one that is behind, with the interpreter lock in its hands, would stop all others.
    """
    _schedule(os.SCHED_RR, _DEVICE_PRIORITY)


def go_back() -> None:
    """Ends `go_ahead`."""
    _schedule(os.SCHED_OTHER, 0)


def _schedule(policy: int, priority: int) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
