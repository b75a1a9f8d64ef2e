"""Stepped time for asyncio: an event loop and the host of a daemon; the clock jumps to what is due next."""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from math import ceil
from typing import Any, TypeVar

from forefeel.common.clock import VirtualClock
from forefeel.common.lateness import Lateness
from forefeel.common.runtime.port import Tick
from forefeel.common.runtime.real import Fault, Host, HostTimers, Loop
from forefeel.common.runtime.threads import Gaps, Worker
from forefeel.common.transport.port import OnFault

T = TypeVar("T")


class _Selector(selectors.DefaultSelector):
    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self._clock = clock

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if not ready:
            assert timeout is not None, "everything waits, and nothing is due"
            self._clock.set_ns(self._clock.now_ns() + ceil(timeout * 1e9))
        return ready


class SteppedLoop(asyncio.SelectorEventLoop):
    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(_Selector(clock))
        self._stepped = clock

    def time(self) -> float:
        return self._stepped.now_ns() * 1e-9


class SteppedWorker(Worker):
    """Works on the running event loop, once it is started."""

    _started = False

    def start(self) -> None:
        self._started = True

    def wake(self) -> None:
        if self._started:
            asyncio.get_running_loop().call_soon(self._go)

    def pause(self, seconds: float) -> None: ...

    def _go(self) -> None:
        wait_s = None if self._closing else self._work(False)
        if wait_s is not None:
            asyncio.get_running_loop().call_later(wait_s, self._go)


class SteppedHost(Host):
    """Loops and timers tick on the running event loop; work for a thread is done at once."""

    worker = SteppedWorker

    def __init__(self) -> None:
        self.clock = self.stepped = VirtualClock(1_000_000_000)

    def loop(self, name: str, period_ns: int, tick: Tick, fault: Fault) -> Loop:
        del name
        return _SteppedTicks(period_ns, tick, self.stepped, fault)

    def timers(self, fault: OnFault) -> HostTimers:
        return _SteppedTimers(self.stepped, fault)

    def in_thread(self, work: Callable[[], T], name: str) -> "Future[T]":
        del name
        future: Future[T] = Future()
        try:
            future.set_result(work())
        except Exception as error:  # noqa: BLE001 - raised where the result is asked for
            future.set_exception(error)
        return future

    def gaps(self) -> Gaps:
        return Gaps(self.clock, longest_s=0.0)

    def prepare_process(self) -> str:
        return "memory as it was"

    def prepare_thread(self, priority: int) -> str:
        return f"priority {priority} not asked for"

    def raise_threads(self, priority: int) -> None: ...

    def keep_core(self, highest: bool) -> None: ...

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        with asyncio.Runner(loop_factory=lambda: SteppedLoop(self.stepped)) as runner:
            return runner.run(coroutine)


class _SteppedTicks:
    def __init__(self, period_ns: int, tick: Tick, clock: VirtualClock, fault: Fault) -> None:
        self.lateness, self.scheduling = Lateness(), "stepped"
        self._period_s, self._tick, self._clock, self._fault = period_ns * 1e-9, tick, clock, fault
        self._handle: asyncio.TimerHandle | None = None

    def start(self, priority: int) -> None:
        del priority
        self._handle = asyncio.get_running_loop().call_later(self._period_s, self._run)

    def stop(self) -> None:
        if self._handle is not None:
            self._handle.cancel()

    def _run(self) -> None:
        self.start(0)
        self.lateness.record_on_time()
        try:
            self._tick(self._clock.now_ns())
        except Exception as error:  # noqa: BLE001 - as the edge of a thread
            self.lateness.ended = True
            self.stop()
            self._fault(error)


class _SteppedTimers:
    def __init__(self, clock: VirtualClock, fault: OnFault) -> None:
        self._clock, self._fault, self._closed = clock, fault, False

    def start(self) -> None: ...

    def close(self) -> None:
        self._closed = True

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        delay_s = max(0, due_ns - self._clock.now_ns()) * 1e-9
        asyncio.get_running_loop().call_later(delay_s, self._run, action)

    def _run(self, action: Callable[[], None]) -> None:
        if self._closed:
            return
        try:
            action()
        except Exception as error:  # noqa: BLE001 - as the edge of a thread
            self._fault(error)
