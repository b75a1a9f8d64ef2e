"""Work beside a loop that must not wait for it: once, or whenever there is something to do."""

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Event, Thread
from time import sleep
from typing import TypeVar

from forefeel.common.clock import Clock

T = TypeVar("T")


def in_thread(work: Callable[[], T], name: str) -> "Future[T]":
    """Runs `work` in a new daemon thread; returns at once the future of its result, or of its exception.

    A process that ends does not wait for it, as it does for the threads of an executor, and of
    asyncio.to_thread. The thread inherits the scheduling of the one that calls this (docs/decisions/0008).
    """
    future: Future[T] = Future()
    future.set_running_or_notify_cancel()  # from here on whoever no longer waits can not disturb the thread

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised where the result is asked for
            future.set_exception(error)

    Thread(target=run, name=name, daemon=True).start()
    return future


class Gaps:
    """The time between the ticks of a loop, in which long work beside it goes on.

    Whoever waits for the interpreter lock asks for it only when nobody has let it go for a switch interval.
    numpy lets it go, and takes it back, in every operation: beside it a loop waited for up to 6 ms.

    Args:
        clock: of the loop.
        longest_s: s after which work goes on without a tick, as when the loop has ended.
    """

    def __init__(self, clock: Clock, longest_s: float = 0.01) -> None:
        self._clock, self._longest_s = clock, longest_s
        self._until_ns = -1
        self._begun: SimpleQueue[None] = SimpleQueue()

    def begin(self, until_ns: int) -> None:
        """Opens a gap until that stamp, and wakes who waits; called by the loop after a tick."""
        self._until_ns = until_ns
        if self._begun.empty():
            self._begun.put(None)

    def wait(self) -> bool:
        """Waits for a gap, `longest_s` at most; True inside one, at once or once it opens, else False."""
        if self._clock.now_ns() <= self._until_ns:
            return True
        with suppress(Empty):
            self._begun.get_nowait()  # of the gap that is over
        try:
            self._begun.get(timeout=self._longest_s)
        except Empty:
            return False
        return True


class Worker:
    """Calls `work(False)` in its own thread when woken, or once the seconds have passed that it returned
    (None: only when woken). `close` ends the thread and calls `work(True)` in the thread of its caller.
    """

    def __init__(self, name: str, work: Callable[[bool], float | None]) -> None:
        self._work = work
        self._woken = Event()
        self._closing = False
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def wake(self) -> None:
        self._woken.set()

    def close(self) -> None:
        self._closing = True
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join()
        self._work(True)

    def pause(self, seconds: float) -> None:
        """Lets other threads have the interpreter."""
        sleep(seconds)

    def _run(self) -> None:
        wait_s: float | None = None
        while not self._closing:
            self._woken.wait(wait_s)
            self._woken.clear()
            wait_s = self._work(False)
