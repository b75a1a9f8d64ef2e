"""Real time: loops in dedicated threads, tasks on asyncio under one TaskGroup, faults from every thread in
one place.
"""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from typing import Protocol, TypeVar

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.lateness import Lateness
from forefeel.common.runtime.port import Pause, Tick
from forefeel.common.runtime.realtime import (
    RealtimeThread,
    keep_core,
    prepare_process,
    prepare_thread,
    raise_threads,
)
from forefeel.common.runtime.threads import Gaps, Worker, in_thread
from forefeel.common.transport.port import OnFault, Timers
from forefeel.common.transport.timers import TimerThread

T = TypeVar("T")
Fault = Callable[[BaseException], None]


class Loop(Protocol):
    lateness: Lateness
    scheduling: str

    def start(self, priority: int) -> None: ...

    def stop(self) -> None: ...


class HostTimers(Timers, Protocol):
    """Timers that are started and closed with their runtime."""

    def start(self) -> None: ...

    def close(self) -> None: ...


class Host:
    """The machine that a runtime runs on: clock, threads, scheduling. Tests have one in stepped time."""

    worker: type[Worker] = Worker
    in_thread = staticmethod(in_thread)
    prepare_process = staticmethod(prepare_process)
    prepare_thread = staticmethod(prepare_thread)
    raise_threads = staticmethod(raise_threads)
    keep_core = staticmethod(keep_core)

    def __init__(self) -> None:
        self.clock: Clock = MonotonicClock()

    def loop(self, name: str, period_ns: int, tick: Tick, fault: Fault) -> Loop:
        return RealtimeThread(name, period_ns, tick, MonotonicClock(), fault)

    def timers(self, fault: OnFault) -> HostTimers:
        return TimerThread(self.clock, fault)

    def gaps(self) -> Gaps:
        return Gaps(self.clock)


HOST = Host()


class RealRuntime:
    """Drives one daemon on the clock of its host.

    Use: register loops and tasks, then `async with runtime:`; leaving it cancels tasks and joins threads.
    `stopping` is set by a fault or by `stop`; whoever runs the daemon waits for it.
    """

    def __init__(self, priority: int = 0, host: Host | None = None) -> None:
        self.host = host or HOST
        self.clock = self.host.clock
        self.stopping = asyncio.Event()
        self.error: BaseException | None = None
        self.timers = self.host.timers(self.fault)
        self._gaps = self.host.gaps()
        self._priority = priority
        self._memory = "not started"
        self._loops: list[Loop] = []
        self._tasks: list[tuple[str, int, Tick]] = []
        self._group = asyncio.TaskGroup()
        self._running: list[asyncio.Task[None]] = []
        self._reactions: list[Callable[[BaseException], None]] = []
        self._asyncio = asyncio.get_running_loop()

    @property
    def scheduling(self) -> str:
        return ", ".join([*sorted({loop.scheduling for loop in self._loops}), self._memory])

    @property
    def ticks(self) -> tuple[int, ...]:
        return tuple(loop.lateness.ticks for loop in self._loops)

    def loop(self, name: str, period_ns: int, tick: Tick) -> Lateness:
        """Registers a loop that calls `tick` every `period_ns` in its own thread; returns its lateness. Each
        tick opens a gap for computations, until half a period after the tick's stamp.
        """

        def ticked(now_ns: int) -> None:
            tick(now_ns)
            self._gaps.begin(now_ns + period_ns // 2)

        thread = self.host.loop(name, period_ns, ticked, self.fault)
        self._loops.append(thread)
        return thread.lateness

    def task(self, name: str, period_ns: int, tick: Tick) -> None:
        self._tasks.append((name, period_ns, tick))

    def compute(self, work: Callable[[Pause], T]) -> "Future[T]":
        return self.host.in_thread(partial(work, self._gaps.wait), "computation")

    def on_fault(self, reaction: Callable[[BaseException], None]) -> None:
        self._reactions.append(reaction)

    def fault(self, error: BaseException) -> None:
        """Runs the safety reactions on the thread that failed, then sets `stopping`, which ends the daemon;
        keeps the first error in `error`. A reaction that raises, in spite of its contract, prevents neither
        the others nor the end; its error is raised afterwards.
        """
        if self.error is None:
            self.error = error
        with ExitStack() as reactions:  # a stack: the last one first
            reactions.callback(self._asyncio.call_soon_threadsafe, self.stopping.set)
            for reaction in reversed(self._reactions):
                reactions.callback(reaction, error)

    def stop(self) -> None:
        """Asks for an orderly end (signals, end of the run); from asyncio's thread."""
        self.stopping.set()

    async def __aenter__(self) -> "RealRuntime":
        self._memory = self.host.prepare_process()
        self.timers.start()
        for loop in self._loops:
            loop.start(self._priority)
        await self._group.__aenter__()
        self._running = [
            self._group.create_task(self._periodic(period_ns, tick), name=name)
            for name, period_ns, tick in self._tasks
        ]
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._running:
            task.cancel()
        await self._group.__aexit__(None, None, None)
        for end in *(loop.stop for loop in self._loops), self.timers.close:
            await asyncio.wrap_future(self.host.in_thread(end, "end of a thread"))

    def raise_fault(self) -> None:
        """Raises the first fault, if there was one, as a RunError with its cause."""
        if self.error is not None:
            raise RunError(f"stopped by a fault: {type(self.error).__name__}: {self.error}") from self.error

    async def _periodic(self, period_ns: int, tick: Tick) -> None:
        """Calls `tick` at once and every period until cancelled; an exception of it is a fault and ends this.
        After a call that starts a period late or more, the next one comes a period later.
        """
        deadline_ns = self.clock.now_ns()
        try:
            while True:
                now_ns = self.clock.now_ns()
                tick(now_ns)
                skipped = now_ns - deadline_ns >= period_ns
                deadline_ns = (now_ns if skipped else deadline_ns) + period_ns
                await asyncio.sleep((deadline_ns - self.clock.now_ns()) * 1e-9)
        except Exception as error:  # noqa: BLE001 - a task's last line: every fault goes to the safety reaction
            self.fault(error)
