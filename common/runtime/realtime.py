"""A fixed-rate loop in a dedicated thread on absolute deadlines, and what the operating system grants it."""

import ctypes
import gc
import os
import resource
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.lateness import Lateness
from forefeel.common.runtime.port import Tick

# flags of mlockall(2) as on x86 and ARM (asm-generic/mman.h)
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_NAME, _PR_SET_TIMERSLACK = 15, 29  # options of prctl(2) (linux/prctl.h)
SWITCH_INTERVAL_S = 5e-5  # a busy thread gives the interpreter lock away after 0.05 ms, not after 5 ms
TICK_INTERVAL_S = 5e-4  # except a loop in its tick, and in the moment before
_LEAD_NS = 300_000
"""A loop takes the interpreter lock so long before its deadline (docs/decisions/0008)."""
_MOST_SPIN_NS = 150_000
"""And does not sleep any more for up to so long before it, see `WakeUp`."""


def raise_descriptor_limit() -> None:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def prepare_process() -> str:
    """Prepares the process for real-time loops: raises the limit of descriptors, shortens the switch
    interval, exempts present objects from garbage collection, locks memory; returns in words whether it did
    lock.

    Memory is locked page by page as it is touched, so that the resident size does not grow by unused stacks.
    """
    raise_descriptor_limit()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0:
        return "memory locked"
    return f"memory not locked ({os.strerror(ctypes.get_errno())})"


def prepare_thread(priority: int) -> str:
    """Asks for the finest timer slack for this thread, and for SCHED_FIFO unless `priority` is 0; returns the
    scheduling that was granted, in words.
    """
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    if priority == 0:
        return "normal scheduling (priority 0 configured)"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"normal scheduling (SCHED_FIFO {priority} not granted: {error.strerror})"
    cores = os.sched_getaffinity(0)
    return f"SCHED_FIFO {priority}{f' on core {min(cores)}' if len(cores) == 1 else ''}"


def raise_threads(priority: int) -> None:
    """Sets SCHED_RR of that priority for all threads that the process has now, where permitted: equals take
    turns of 0.1 s. Under SCHED_FIFO one of Zenoh's that spins for a lock would keep the core for ever from
    the one that holds it, where it was raised before that one: 3 of some 400 masters stood still at start.
    """
    for _ in range(2):  # a second time for what was just being started
        for thread in _threads():
            with suppress(OSError):  # not granted, as `prepare_thread` says of the loop; or ended
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))


def _is_realtime() -> bool:
    return os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR)


def _threads() -> list[int]:
    return [int(task.name) for task in Path("/proc/self/task").iterdir()]


def keep_core(highest: bool) -> None:
    """Pins all threads of the process to the first core that no other daemon of this host has taken, until
    the process ends. Does nothing under normal scheduling, or where no core is free.

    The kernel wakes each thread on whatever core is idle, which costs an eighth more processor time and
    doubles the lateness (docs/decisions/0008). `highest`: searches from the last core down; master and slave
    in containers, which do not see each other, begin at different ends.
    """
    if not _is_realtime():
        return
    for core in sorted(os.sched_getaffinity(0), reverse=highest):
        mine = socket.socket(socket.AF_UNIX)
        try:
            mine.bind(f"\0forefeel core {core}")  # an abstract name: it is free again when the process ends
        except OSError:
            mine.close()
            continue
        _KEPT.append(mine)
        for thread in _threads():
            with suppress(OSError):  # it has ended
                os.sched_setaffinity(thread, {core})
        return


_KEPT: list[socket.socket] = []


def go_before(steps: int) -> None:
    """Raises the calling thread's real-time priority by `steps`; threads that it starts inherit it. Does
    nothing under normal scheduling, or where not permitted. Equals wait for each other, for 0.1 s or, under
    SCHED_FIFO, however long one of them computes.
    """
    if not _is_realtime():
        return
    raised = os.sched_param(os.sched_getparam(0).sched_priority + steps)
    with suppress(OSError):  # not granted: it stays where it is
        os.sched_setparam(0, raised)


class WakeUp:
    """Estimates how late the kernel wakes this thread: `spin_ns`, the 95 % quantile, from 0 to 0.15 ms.

    A stochastic approximation of the quantile (Robbins and Monro 1951): up by 0.95 of the step where a
    wake-up was later, else down by 0.05 of it.
    """

    # of the quantile; the rest would cost as much again (docs/decisions/0008)
    _SHARE = 0.95
    _STEP_NS = 2000

    def __init__(self) -> None:
        self.spin_ns: float = _MOST_SPIN_NS

    def note(self, late_ns: int) -> None:
        wanted_ns = self.spin_ns + self._STEP_NS * (self._SHARE - (late_ns <= self.spin_ns))
        self.spin_ns = min(max(wanted_ns, 0.0), _MOST_SPIN_NS)


class RealtimeThread:
    """Calls `tick` every `period_ns` in a thread of its own; a tick that is a period or more late skips the
    missed deadlines, counted. A clock that goes back is a fault, as what is too old would be young again; the
    loop goes on to react. A tick that raises is a fault and ends the loop: `lateness.ended`.
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
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._priority = 0
        self._wake_up = WakeUp()
        self._ahead = True

    def start(self, priority: int) -> None:
        self._priority = priority
        self._thread.start()

    def stop(self) -> None:
        self._stopped.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        """Body of the thread: asks for its priority, sets `scheduling` and the thread's name, and ticks until
        stopped. An exception sets `lateness.ended` and is reported as a fault.
        """
        try:
            self.scheduling = prepare_thread(self._priority)
            self._ahead = os.sched_getscheduler(0) == os.SCHED_FIFO
            ctypes.CDLL(None).prctl(_PR_SET_NAME, self.name.encode(), 0, 0, 0)  # as top -H and perf show it
            self.pace()
        except BaseException as error:  # noqa: BLE001 - the thread's last line: every fault goes to the safety reaction
            self.lateness.ended = True  # first: a reaction must not wait for a tick that never comes
            self._fault(error)

    def pace(self) -> None:
        """Calls `tick` at each deadline in the calling thread until stopped, and records its lateness; a tick
        that is a period late or more skips the deadlines it missed, counted. Exceptions of `tick` propagate.
        """
        clock, period_ns = self._clock, self._period_ns
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        deadline_ns = clock.now_ns() + period_ns
        while not self._stopped.is_set():
            self._wait(self._at_hand(deadline_ns, clock.now_ns()))
            now_ns = clock.now_ns()
            deadline_ns = self._at_hand(deadline_ns, now_ns)
            late_ns = max(0, now_ns - deadline_ns)  # a sleep in which the clock was slow ends early
            self.lateness.record(late_ns)
            self._tick(now_ns)
            sys.setswitchinterval(SWITCH_INTERVAL_S)
            skipped = late_ns // period_ns
            self.lateness.missed += skipped
            deadline_ns += (1 + skipped) * period_ns

    def _wait(self, deadline_ns: int) -> None:
        """Waits for the deadline: sleeps to 0.3 ms before it, then holds the interpreter lock, first asleep,
        at last spinning. Sleeps throughout, without the lock, under normal scheduling, where it is processors
        that are waited for, and with less than 0.3 ms left, so that other threads run at all.
        """
        if not self._ahead or self._clock.now_ns() > deadline_ns - _LEAD_NS:
            self._clock.sleep_until_ns(deadline_ns)
            return
        self._clock.sleep_until_ns(deadline_ns - _LEAD_NS)
        early_ns = min(_LEAD_NS, deadline_ns - self._clock.now_ns())
        if early_ns <= 0:
            return
        sys.setswitchinterval(TICK_INTERVAL_S)
        hold_ns = early_ns - int(self._wake_up.spin_ns)
        if hold_ns > 0:
            wake_ns = self._clock.now_ns() + hold_ns
            self._clock.hold_ns(hold_ns)
            self._wake_up.note(self._clock.now_ns() - wake_ns)
        while 0 < deadline_ns - self._clock.now_ns() <= _LEAD_NS:
            pass

    def _at_hand(self, deadline_ns: int, now_ns: int) -> int:
        """Returns the deadline; if the clock went back, so that the deadline is over two periods ahead,
        reports a fault and returns `now_ns`.
        """
        ahead_ns = deadline_ns - now_ns
        if ahead_ns <= 2 * self._period_ns:
            return deadline_ns
        self._fault(RunError(f"{self.name} loop: the clock went back by {ahead_ns * 1e-9:.3f} s"))
        return now_ns
