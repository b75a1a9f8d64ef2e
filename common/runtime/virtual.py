"""Virtual time: every loop, task and timer of every daemon on one event heap; as fast as the machine can, bit
for bit repeatable.
"""

import heapq
from collections.abc import Callable
from concurrent.futures import Future
from itertools import count

from forefeel.common.clock import VirtualClock
from forefeel.common.lateness import Lateness
from forefeel.common.runtime.port import Pause, T, Tick

_Event = tuple[int, int, int, Callable[..., None]]
"""(due stamp, order, period or 0, action): a periodic action is given the stamp, a single one nothing."""


class VirtualRuntime:
    """Runs both daemons from one event heap. Events of equal stamp run in the order of their scheduling."""

    scheduling = "virtual time: no lateness"

    def __init__(self, start_ns: int = 1_000_000_000) -> None:
        self.clock = VirtualClock(start_ns)
        self.timers = self
        self._order = count()
        self._events: list[_Event] = []

    def loop(self, name: str, period_ns: int, tick: Tick) -> Lateness:
        """Schedules `tick` every `period_ns`, first after one period; returns a Lateness, all on time."""
        del name
        lateness = Lateness()

        def counted(now_ns: int) -> None:
            lateness.record_on_time()
            tick(now_ns)

        self._push(self.clock.now_ns() + period_ns, period_ns, counted)
        return lateness

    def task(self, name: str, period_ns: int, tick: Tick) -> None:
        del name
        self._push(self.clock.now_ns() + period_ns, period_ns, tick)

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._events, (max(due_ns, self.clock.now_ns()), next(self._order), 0, action))

    def compute(self, work: Callable[[Pause], T]) -> "Future[T]":
        future: Future[T] = Future()
        future.set_result(work(lambda: None))
        return future

    def fault(self, error: BaseException) -> None:
        """Raises the error: in virtual time a fault ends the run at once, with its own traceback."""
        raise error

    def on_fault(self, reaction: Callable[[BaseException], None]) -> None:
        """Does nothing: faults propagate out of `run`; nobody is left to react."""

    def run(self, duration_ns: int, progress: Callable[[int], bool] | None = None) -> None:
        """Runs the events due in the next `duration_ns`, each with the clock at its stamp, and leaves the
        clock at the end of that time. `progress` is called with the stamp about every 100 ms of that time; if
        it returns False, the run ends there.
        """
        end_ns = self.clock.now_ns() + duration_ns
        next_report = self.clock.now_ns()
        events, set_ns = self._events, self.clock.set_ns
        while events and events[0][0] <= end_ns:
            due_ns, _, period_ns, action = events[0]
            set_ns(due_ns)
            if period_ns:
                heapq.heapreplace(events, (due_ns + period_ns, next(self._order), period_ns, action))
                action(due_ns)
            else:
                heapq.heappop(events)
                action()
            if progress is not None and due_ns >= next_report:
                next_report = due_ns + 100_000_000
                if not progress(due_ns):
                    return
        self.clock.set_ns(end_ns)

    def _push(self, due_ns: int, period_ns: int, action: Callable[[int], None]) -> None:
        heapq.heappush(self._events, (due_ns, next(self._order), period_ns, action))
