"""Loops, tasks and faults of a daemon's runtime in stepped time."""

import asyncio
import os
import socket
import sys
from collections.abc import Awaitable, Callable, Iterator

import numpy as np
import pytest

from forefeel.common.clock import MonotonicClock, VirtualClock
from forefeel.common.errors import RunError
from forefeel.common.runtime import realtime
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.runtime.realtime import (
    SWITCH_INTERVAL_S,
    TICK_INTERVAL_S,
    RealtimeThread,
    WakeUp,
    keep_core,
    prepare_thread,
)
from forefeel.common.runtime.threads import Gaps
from tests.stepped import SteppedHost
from tests.unit.failing import refusing

MS = 1_000_000


def test_long_work_goes_on_between_ticks_only() -> None:
    clock = VirtualClock(0)
    gaps = Gaps(clock, longest_s=0.0)

    assert not gaps.wait()
    gaps.begin(MS // 2)
    assert gaps.wait()
    assert gaps.wait()
    clock.set_ns(MS)
    assert not gaps.wait()


# --- the loop of a real-time thread, in the thread of the test ---


class Clock(MonotonicClock):
    """Goes on by a microsecond at each reading, by as much as is slept, and by `jumps_ns` when asked to."""

    def __init__(self) -> None:
        self.at_ns = 0
        self.held: list[int] = []

    def now_ns(self) -> int:
        self.at_ns += 1000
        return self.at_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.at_ns = max(self.at_ns, deadline_ns)

    def hold_ns(self, duration_ns: int) -> None:
        self.held.append(duration_ns)
        self.at_ns += duration_ns


class Paced:
    """A loop of 1 kHz that is stopped at its tick number `count`; `act` is called in each tick."""

    def __init__(self, count: int, act: Callable[["Paced"], None] = lambda _: None) -> None:
        self.clock, self.ticks, self.intervals = Clock(), list[int](), list[float]()
        self.faults = list[BaseException]()
        self._count, self._act = count, act
        self.loop = RealtimeThread("pace", MS, self._tick, self.clock, self.faults.append)
        self.loop.pace()

    def _tick(self, now_ns: int) -> None:
        self.ticks.append(now_ns)
        self.intervals.append(sys.getswitchinterval())
        if len(self.ticks) == self._count:
            self.loop.stop()
        self._act(self)


@pytest.fixture(autouse=True)
def interval_as_it_was() -> Iterator[None]:
    before_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(before_s)


def test_late_tick_skips_missed_deadlines() -> None:
    def once(paced: Paced) -> None:
        if len(paced.ticks) == 3:
            paced.clock.at_ns += 20 * MS

    paced = Paced(6, once)
    assert paced.loop.lateness.missed in (19, 20)
    assert paced.ticks[3] - paced.ticks[2] >= 20 * MS
    assert np.diff(paced.ticks[3:]).tolist() == pytest.approx([MS, MS], abs=30_000)
    assert paced.loop.lateness.max_us >= 18_000


def test_clock_that_goes_back_is_a_fault_and_the_loop_goes_on() -> None:
    def step_back(paced: Paced) -> None:
        if len(paced.ticks) == 5:
            paced.clock.at_ns -= 3_600_000 * MS

    paced = Paced(30, step_back)
    assert 1 <= len(paced.faults) <= 2
    assert "went back by 3600" in str(paced.faults[0])
    assert len(paced.ticks) == 30


def test_slow_clock_that_ticks_early_misses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def sleep_a_tenth(clock: Clock, deadline_ns: int) -> None:
        clock.at_ns += max(0, deadline_ns - clock.at_ns) // 10

    monkeypatch.setattr(Clock, "sleep_until_ns", sleep_a_tenth)
    paced = Paced(20)
    assert paced.ticks[-1] - paced.ticks[0] < 19 * MS, "none was early"
    assert paced.loop.lateness.missed == 0


@pytest.mark.parametrize("begins", [True, False])
def test_loop_that_fails_has_ended_before_the_reaction(monkeypatch: pytest.MonkeyPatch, begins: bool) -> None:
    ended = list[bool]()
    refuse = refusing(MemoryError("no thread"))
    monkeypatch.setattr(realtime, "prepare_thread", (lambda _: "left alone") if begins else refuse)
    loop = RealtimeThread("pace", MS, refuse, Clock(), lambda _: ended.append(loop.lateness.ended))
    loop._run()
    assert ended == [True]


@pytest.mark.parametrize("usual_us", [5.0, 15.0])
def test_one_wake_up_in_twenty_is_later(usual_us: float) -> None:
    draw, wake_up = np.random.default_rng(1), WakeUp()
    later = []
    for late_ns in 25e3 + draw.exponential(1e3 * usual_us, 60_000):
        later.append(late_ns > wake_up.spin_ns)
        wake_up.note(int(late_ns))
    assert 0.04 < float(np.mean(later[20_000:])) < 0.06


def test_wake_up_of_a_stalling_machine_is_bounded() -> None:
    wake_up = WakeUp()
    for _ in range(20_000):
        wake_up.note(0)
    assert wake_up.spin_ns == 0
    for _ in range(200):
        wake_up.note(5_000_000)
    assert wake_up.spin_ns == 150_000


def test_priority_that_is_not_granted_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_setscheduler", refusing(PermissionError(1, "Operation not permitted")))
    monkeypatch.setattr("ctypes.CDLL", lambda _: type("libc", (), {"prctl": lambda *_: 0}))
    assert "SCHED_FIFO 50 not granted" in prepare_thread(50)
    assert "priority 0" in prepare_thread(0)


@pytest.fixture
def affinities(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[set[int]]]:
    """What is asked for on a host with two cores, as under SCHED_FIFO."""
    asked: list[set[int]] = []
    kept: list[socket.socket] = []
    monkeypatch.setattr("os.sched_getscheduler", lambda _: os.SCHED_FIFO)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {7000, 7001})
    monkeypatch.setattr("os.sched_setaffinity", lambda _, cores: asked.append(cores))
    monkeypatch.setattr(realtime, "_KEPT", kept)
    monkeypatch.setattr(realtime, "_threads", lambda: [0])
    yield asked
    for each in kept:
        each.close()


# --- the runtime ---

Start = Callable[[RealRuntime, Callable[[int], None]], object]
STARTS: dict[str, Start] = {
    "loop": lambda runtime, tick: runtime.loop("loop", MS, tick),
    "task": lambda runtime, tick: runtime.task("task", MS, tick),
    "timer": lambda runtime, tick: runtime.timers.call_at(0, lambda: tick(0)),
}


def run(
    act: Callable[[RealRuntime], object],
    inside: Callable[[RealRuntime], Awaitable[object]] = lambda _: asyncio.sleep(0.05),
    host: SteppedHost | None = None,
) -> RealRuntime:
    """A runtime that was given something to do, after what happens inside."""
    host = host or SteppedHost()

    async def main() -> RealRuntime:
        runtime = RealRuntime(host=host)
        act(runtime)
        async with runtime:
            await inside(runtime)
            assert runtime.stopping.is_set() == (runtime.error is not None)
        return runtime

    return host.run(main())


@pytest.mark.parametrize("kind", STARTS)
def test_fault_reaches_every_reaction_and_keeps_its_cause(kind: str) -> None:
    heard = list[tuple[str, BaseException]]()
    cause = ValueError("torn cable")

    def act(runtime: RealRuntime) -> None:
        runtime.on_fault(lambda error: heard.append(("first", error)))
        runtime.on_fault(lambda error: heard.append(("second", error)))
        STARTS[kind](runtime, refusing(cause))

    runtime = run(act)
    assert heard == [("first", cause), ("second", cause)]
    with pytest.raises(RunError, match="ValueError: torn cable") as caught:
        runtime.raise_fault()
    assert caught.value.__cause__ is cause


def test_reaction_that_fails_keeps_no_other_from_its_own() -> None:
    heard = list[str]()

    def react(runtime: RealRuntime) -> None:
        runtime.on_fault(refusing(OSError("no hold")))
        runtime.on_fault(lambda error: heard.append(str(error)))

    async def inside(runtime: RealRuntime) -> None:
        with pytest.raises(OSError, match="no hold"):
            runtime.fault(ValueError("first"))
        await asyncio.sleep(0.01)

    with pytest.raises(RunError, match="ValueError: first"):
        run(react, inside).raise_fault()
    assert heard == ["first"]


def test_loop_that_fails_stops_no_other() -> None:
    ticks = list[int]()

    def act(runtime: RealRuntime) -> None:
        runtime.loop("bad", MS, refusing(ValueError()))
        runtime.loop("good", MS, ticks.append)

    run(act)
    assert len(ticks) >= 49


def test_tasks_never_catch_up_in_a_burst() -> None:
    ticks, host = list[int](), SteppedHost()

    async def inside(_: RealRuntime) -> None:
        await asyncio.sleep(0.0105)
        host.stepped.set_ns(ticks[-1] + 30 * MS)  # asyncio stands
        await asyncio.sleep(0.005)

    run(lambda runtime: runtime.task("soft", 2 * MS, ticks.append), inside, host)
    assert [round(each / MS) for each in np.diff(ticks)] == [2] * 5 + [30, 2, 2]


@pytest.mark.parametrize("how", ["leaves", "raises", "cancelled"])
def test_runtime_leaves_nothing_behind(how: str) -> None:
    host = SteppedHost()

    async def main() -> None:
        runtime = RealRuntime(host=host)
        for kind in "loop", "task":
            STARTS[kind](runtime, lambda _: None)
        async with runtime:
            await asyncio.sleep(0.01)
            if how == "raises":
                raise KeyError("inside")
            if how == "cancelled":
                await runtime.stopping.wait()

    async def outer() -> None:
        task = asyncio.create_task(main())
        await asyncio.sleep(0.05)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    host.run(outer())


def test_loop_ticks_on_its_deadlines_and_holds_the_interpreter_longer_in_a_tick() -> None:
    paced = Paced(20)
    late_ns = np.array(paced.ticks) - MS * np.arange(1, 21)
    assert late_ns.min() >= 0 and late_ns.max() < 20_000
    assert (paced.loop.lateness.ticks, paced.loop.lateness.missed) == (20, 0)
    assert paced.intervals == pytest.approx([TICK_INTERVAL_S] * 20)
    assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)


def lasting(duration_ns: int) -> Callable[[Paced], None]:
    def act(paced: Paced) -> None:
        paced.clock.at_ns += duration_ns

    return act


def test_late_tick_does_not_hold_the_interpreter_nor_does_the_wait_after_a_long_one() -> None:
    assert Paced(10, lasting(3 * MS // 2)).intervals[1:] == pytest.approx([SWITCH_INTERVAL_S] * 9)
    assert len(Paced(50, lasting(3 * MS // 4)).clock.held) <= 1


def test_each_daemon_keeps_a_core_of_its_own_while_there_is_one_and_none_unless_it_is_realtime(
    affinities: list[set[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    for highest in (True, False, True):
        keep_core(highest)
    assert affinities == [{7001}, {7000}]
    affinities.clear()
    monkeypatch.setattr(realtime, "_KEPT", [])
    monkeypatch.setattr("os.sched_getscheduler", lambda _: os.SCHED_OTHER)
    keep_core(highest=True)
    assert affinities == []
