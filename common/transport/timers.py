"""Timers in real time: one thread, one heap of stamps."""

import heapq
import threading
from collections.abc import Callable
from itertools import count

from forefeel.common.clock import Clock
from forefeel.common.transport.port import OnFault

_Entry = tuple[int, int, Callable[[], None]]


class TimerThread:
    """Runs actions, of any thread, at stamps of `clock`, the host's monotonic clock, in its own thread.

    An exception of an action goes to `on_fault`; later ones still run. What is not due at `close` never runs.
    """

    def __init__(self, clock: Clock, on_fault: OnFault) -> None:
        self._clock = clock
        self._on_fault = on_fault
        self._order = count()
        self._entries: list[_Entry] = []
        self._changed = threading.Condition(threading.Lock())
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="timers", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        """Runs `action` at `due_ns` or as soon after as possible; actions of equal stamp keep their order."""
        entry = (due_ns, next(self._order), action)
        with self._changed:
            heapq.heappush(self._entries, entry)
            if self._entries[0] is entry:
                self._changed.notify()

    def close(self) -> None:
        """Ends the thread and waits for the action that is running; idempotent."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while (action := self._next()) is not None:
            try:
                action()
            except Exception as error:  # noqa: BLE001 - the edge of the thread
                self._on_fault(error)

    def _next(self) -> Callable[[], None] | None:
        """Waits for the next action that is due and removes it; None once closed."""
        with self._changed:
            while not self._closed:
                if not self._entries:
                    self._changed.wait()
                    continue
                remaining_ns = self._entries[0][0] - self._clock.now_ns()
                if remaining_ns <= 0:
                    return heapq.heappop(self._entries)[2]
                self._changed.wait(remaining_ns * 1e-9)
        return None
