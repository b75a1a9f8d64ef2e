"""A fixed-rate loop in a dedicated thread on absolute deadlines, and what the operating system grants it."""

import ctypes
import gc
import os
import sys
import threading
from collections.abc import Callable

from common.clock import MonotonicClock
from common.lateness import Lateness
from common.runtime.port import Tick

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
SWITCH_INTERVAL_S = 1e-4  # a busy thread gives the interpreter lock away after 0.1 ms, not after 5 ms


def prepare_process() -> str:
    """Settles the process for real-time loops; returns in plain words what was granted.

    Memory is locked page by page as it is touched, so that the resident size does not grow by unused stacks.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0:
        return "memory locked"
    return f"memory not locked ({os.strerror(ctypes.get_errno())})"


def prepare_thread(priority: int) -> str:
    """Asks for SCHED_FIFO and the finest timer slack for the calling thread; returns in plain words what was
    granted.
    """
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    if priority == 0:
        return "normal scheduling (priority 0 configured)"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"normal scheduling (SCHED_FIFO {priority} not granted: {error.strerror})"
    return f"SCHED_FIFO {priority}"


class RealtimeThread:
    """Calls `tick` every `period_ns`; a tick that is a period or more late skips the missed deadlines,
    counted.
    """

    def __init__(
        self,
        name: str,
        period_ns: int,
        tick: Tick,
        clock: MonotonicClock,
        fault: Callable[[BaseException], None],
    ) -> None:
        self.name = name
        self.lateness = Lateness()
        self.scheduling = "not started"
        self._period_ns = period_ns
        self._tick = tick
        self._clock = clock
        self._fault = fault
        self._running = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._priority = 0

    def start(self, priority: int) -> None:
        """Starts the thread; `priority` 0 asks for normal scheduling."""
        self._priority = priority
        self._running.set()
        self._thread.start()

    def stop(self) -> None:
        """Ends after the tick that runs; idempotent."""
        self._running.clear()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        self.scheduling = prepare_thread(self._priority)
        try:
            self._pace()
        except BaseException as error:  # noqa: BLE001 - the thread's last line: every fault goes to the safety reaction
            self._fault(error)

    def _pace(self) -> None:
        clock, period_ns = self._clock, self._period_ns
        deadline_ns = clock.now_ns() + period_ns
        while self._running.is_set():
            clock.sleep_until_ns(deadline_ns)
            now_ns = clock.now_ns()
            late_ns = now_ns - deadline_ns
            self.lateness.record(late_ns)
            self._tick(now_ns)
            skipped = late_ns // period_ns
            self.lateness.missed += skipped
            deadline_ns += (1 + skipped) * period_ns
