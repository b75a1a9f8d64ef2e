import asyncio
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from itertools import pairwise

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.lateness import Lateness
from forefeel.common.runtime import real, realtime
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.runtime.realtime import SWITCH_INTERVAL_S, TICK_INTERVAL_S, go_before, prepare_thread
from tests.unit.failing import refusing
from tests.unit.real_time import as_it_is, until
from tests.waiting import PATIENCE_S

MS = 1_000_000

process_as_it_is = pytest.fixture(as_it_is, autouse=True, name="process_as_it_is")


async def stopped(runtime: RealRuntime) -> None:
    await asyncio.wait_for(runtime.stopping.wait(), PATIENCE_S)


def test_a_loop_ticks_in_a_thread_of_its_own_on_its_deadlines() -> None:
    ticks, threads = list[int](), set[str]()

    def tick(now_ns: int) -> None:
        ticks.append(now_ns)
        threads.add(threading.current_thread().name)

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        lateness = runtime.loop("pace", MS, tick)
        async with runtime:
            await until(lambda: len(ticks) >= 20)
        assert lateness.ticks == len(ticks)
        first_deadline_ns = ticks[0] - round(lateness.max_us * 1e3)
        spent = (ticks[-1] - first_deadline_ns) // MS + 1
        assert lateness.ticks + lateness.missed <= spent
        return runtime

    runtime = asyncio.run(run())
    assert threads == {"pace"}
    assert all(after > before for before, after in pairwise(ticks))
    assert runtime.scheduling == "normal scheduling (priority 0 configured), memory as it was"
    runtime.raise_fault()


def test_a_tick_keeps_the_interpreter_longer_than_what_runs_between_ticks() -> None:
    inside = list[float]()

    async def run() -> None:
        runtime = RealRuntime()
        runtime.loop("pace", MS, lambda _: inside.append(sys.getswitchinterval()))
        async with runtime:
            await until(lambda: len(inside) >= 5 and max(inside) > SWITCH_INTERVAL_S)

    asyncio.run(run())
    assert {round(each, 6) for each in inside} <= {TICK_INTERVAL_S, SWITCH_INTERVAL_S}  # this if it was late
    assert max(inside) == pytest.approx(TICK_INTERVAL_S)
    assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)


def test_a_tick_that_is_late_may_be_interrupted_as_soon_as_anything() -> None:
    inside = list[float]()

    async def run() -> None:
        runtime = RealRuntime()

        def tick(now_ns: int) -> None:
            inside.append(sys.getswitchinterval())
            runtime.clock.sleep_until_ns(now_ns + MS + MS // 2)  # so each but the first is late

        runtime.loop("pace", MS, tick)
        async with runtime:
            await until(lambda: len(inside) >= 10)

    asyncio.run(run())
    assert min(inside) == pytest.approx(SWITCH_INTERVAL_S)


def test_after_a_tick_that_took_long_nothing_is_held_so_that_others_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    held = list[int]()

    async def run() -> None:
        runtime = RealRuntime()
        monkeypatch.setattr(runtime.clock, "hold_ns", held.append)

        def tick(now_ns: int) -> None:
            while runtime.clock.now_ns() < now_ns + 3 * MS // 4:
                pass

        lateness = runtime.loop("pace", MS, tick)
        async with runtime:
            await until(lambda: lateness.ticks >= 50)

    asyncio.run(run())
    assert len(held) <= 2  # before the first, and hardly ever again


@pytest.mark.parametrize("held", [True, False])
def test_no_other_thread_runs_while_the_clock_holds_the_interpreter(held: bool) -> None:
    clock, turns, ended = MonotonicClock(), [0], threading.Event()

    def turn() -> None:
        while not ended.is_set():
            turns[0] += 1
            time.sleep(0)  # gives it

    sys.setswitchinterval(60.0)  # nobody takes the interpreter away; it has to be given
    other = threading.Thread(target=turn)
    other.start()
    try:
        start_ns, before = clock.now_ns(), turns[0]
        clock.hold_ns(20 * MS) if held else clock.sleep_until_ns(start_ns + 20 * MS)
        while not held and turns[0] == before:  # the machine may be late to give the other its turn
            clock.sleep_until_ns(clock.now_ns() + 20 * MS)
        after, end_ns = turns[0], clock.now_ns()
    finally:
        ended.set()
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        other.join()
    assert end_ns - start_ns >= 20 * MS
    assert (after == before) is held


def test_a_clock_that_goes_back_is_a_fault_at_once_and_the_loop_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Stepped(MonotonicClock):
        step_ns = 0

        def now_ns(self) -> int:
            return super().now_ns() + self.step_ns

        def sleep_until_ns(self, deadline_ns: int) -> None:
            super().sleep_until_ns(deadline_ns - self.step_ns)

    monkeypatch.setattr(real, "MonotonicClock", Stepped)
    ticks = list[int]()

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        runtime.loop("pace", MS, ticks.append)
        async with runtime:
            await until(lambda: len(ticks) >= 10)
            Stepped.step_ns = -3_600_000 * MS
            await stopped(runtime)
            went_on = len(ticks) + 20
            await until(lambda: len(ticks) >= went_on)
        return runtime

    runtime = asyncio.run(run())
    with pytest.raises(RunError, match=r"pace loop: the clock went back by (3600|3599)\.\d\d\d s"):
        runtime.raise_fault()


def test_a_tick_before_its_deadline_by_a_slow_clock_has_missed_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    start_ns = MonotonicClock.read_ns()

    def slow_ns() -> int:
        return start_ns + (time.monotonic_ns() - start_ns) // 10

    monkeypatch.setattr(MonotonicClock, "read_ns", staticmethod(slow_ns))
    ticks = list[int]()

    async def run() -> Lateness:
        runtime = RealRuntime()
        lateness = runtime.loop("pace", 5 * MS, ticks.append)
        async with runtime:
            await until(lambda: len(ticks) >= 20)
        return lateness

    lateness = asyncio.run(run())
    deadlines = (ticks[-1] - ticks[0]) // (5 * MS)
    assert len(ticks) > deadlines + 1, "none was early"
    assert 0 <= lateness.missed <= deadlines


def test_a_late_tick_skips_the_deadlines_it_missed_and_counts_them() -> None:
    async def run() -> None:
        runtime = RealRuntime()
        ticks = list[int]()

        def tick(now_ns: int) -> None:
            ticks.append(now_ns)
            if len(ticks) == 3:
                runtime.clock.sleep_until_ns(now_ns + 20 * MS)

        lateness = runtime.loop("pace", MS, tick)
        async with runtime:
            await until(lambda: len(ticks) >= 6)
        assert lateness.missed >= 18
        assert ticks[3] - ticks[2] >= 20 * MS
        assert ticks[5] - ticks[3] > 0
        assert lateness.max_us >= 18_000

    asyncio.run(run())


def test_tasks_tick_on_asyncio_and_never_catch_up_in_a_burst() -> None:
    ticks = list[int]()

    async def run() -> None:
        runtime = RealRuntime()
        runtime.task("soft", 2 * MS, ticks.append)
        async with runtime:
            assert {task.get_name() for task in asyncio.all_tasks()} > {"soft"}
            await until(lambda: len(ticks) >= 3)
            runtime.clock.sleep_until_ns(ticks[-1] + 30 * MS)  # asyncio stands
            before = len(ticks)
            await until(lambda: len(ticks) >= before + 3)
        assert ticks[before + 1] - ticks[before] >= 1.5 * MS

    asyncio.run(run())


Start = Callable[[RealRuntime, Callable[[int], None]], object]


@pytest.mark.parametrize(
    "start",
    [
        lambda runtime, tick: runtime.loop("loop", MS, tick),
        lambda runtime, tick: runtime.task("task", MS, tick),
        lambda runtime, tick: runtime.timers.call_at(0, lambda: tick(0)),
    ],
    ids=["loop", "task", "timer"],
)
def test_a_fault_reaches_every_reaction_and_ends_the_daemon_with_its_cause(start: Start) -> None:
    heard: list[tuple[str, BaseException]] = []
    cause = ValueError("torn cable")

    def fail(_now_ns: int) -> None:
        raise cause

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        runtime.on_fault(lambda error: heard.append(("first", error)))
        runtime.on_fault(lambda error: heard.append(("second", error)))
        start(runtime, fail)
        async with runtime:
            await stopped(runtime)
        return runtime

    runtime = asyncio.run(run())
    assert heard == [("first", cause), ("second", cause)]
    with pytest.raises(RunError, match=r"^stopped by a fault: ValueError: torn cable$") as caught:
        runtime.raise_fault()
    assert caught.value.__cause__ is cause


def test_a_fault_of_a_foreign_thread_runs_the_reactions_there_and_the_first_one_is_kept() -> None:
    where = list[str]()

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        runtime.on_fault(lambda _: where.append(threading.current_thread().name))
        async with runtime:
            for name in ("one", "two"):
                thread = threading.Thread(target=runtime.fault, args=(KeyError(name),), name=name)
                thread.start()
                thread.join()
            await stopped(runtime)
        return runtime

    runtime = asyncio.run(run())
    assert where == ["one", "two"]
    assert str(runtime.error) == "'one'"


def test_a_reaction_that_fails_keeps_neither_the_next_from_its_own_nor_the_daemon_running() -> None:
    heard = list[str]()

    def broken(_: BaseException) -> None:
        raise OSError("no hold")

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        runtime.on_fault(broken)
        runtime.on_fault(lambda error: heard.append(str(error)))
        async with runtime:
            with pytest.raises(OSError, match="no hold"):
                runtime.fault(ValueError("first"))
            await stopped(runtime)
        return runtime

    with pytest.raises(RunError, match="ValueError: first"):
        asyncio.run(run()).raise_fault()
    assert heard == ["first"]


def test_one_loop_that_fails_does_not_stop_the_others() -> None:
    ticks = list[int]()

    async def run() -> None:
        runtime = RealRuntime()
        runtime.loop("bad", MS, refusing(ValueError()))
        runtime.loop("good", MS, ticks.append)
        async with runtime:
            await stopped(runtime)
            after = len(ticks)
            await until(lambda: len(ticks) >= after + 3)

    asyncio.run(run())


def test_a_loop_says_that_it_has_ended_before_the_reactions_to_its_fault() -> None:
    ended = list[bool]()

    async def run() -> None:
        runtime = RealRuntime()
        bad, good = runtime.loop("bad", MS, refusing(ValueError())), runtime.loop("good", MS, lambda _: None)
        runtime.on_fault(lambda _: ended.extend((bad.ended, good.ended)))
        async with runtime:
            await stopped(runtime)

    asyncio.run(run())
    assert ended == [True, False]


def test_a_loop_that_can_not_even_begin_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_priority: int) -> str:
        raise MemoryError("no thread")

    monkeypatch.setattr(realtime, "prepare_thread", refuse)

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        runtime.loop("loop", MS, lambda _: None)
        async with runtime:
            await stopped(runtime)
        return runtime

    with pytest.raises(RunError, match="MemoryError: no thread"):
        asyncio.run(run()).raise_fault()


def test_leaving_joins_every_thread_and_ends_every_task() -> None:
    async def run() -> RealRuntime:
        runtime = RealRuntime()
        for i in range(3):
            runtime.loop(f"loop {i}", MS, lambda _: None)
            runtime.task(f"task {i}", MS, lambda _: None)
        before = set(threading.enumerate())
        async with runtime:
            started = {thread.name for thread in threading.enumerate()} - {t.name for t in before}
            assert started == {"loop 0", "loop 1", "loop 2", "timers"}
            runtime.stop()
            assert runtime.stopping.is_set()
        left = {thread.name for thread in threading.enumerate()} - {t.name for t in before}
        assert not {name for name in left if not name.startswith("asyncio")}
        assert [task.get_name() for task in asyncio.all_tasks() if task is not asyncio.current_task()] == []
        return runtime

    asyncio.run(run()).raise_fault()


def test_an_exception_inside_leaves_nothing_behind_and_is_raised() -> None:
    async def run() -> None:
        runtime = RealRuntime()
        runtime.loop("loop", MS, lambda _: None)
        runtime.task("task", MS, lambda _: None)
        async with runtime:
            raise KeyError("inside")

    with pytest.raises(KeyError, match="inside"):
        asyncio.run(run())


def test_a_cancelled_daemon_leaves_nothing_behind() -> None:
    async def run() -> None:
        runtime = RealRuntime()
        runtime.loop("loop", MS, lambda _: None)
        runtime.task("task", MS, lambda _: None)
        async with runtime:
            await runtime.stopping.wait()

    async def outer() -> None:
        task = asyncio.create_task(run())
        await asyncio.sleep(0.01)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(outer())


def test_a_loop_that_was_never_started_stops_at_once() -> None:
    async def run() -> None:
        runtime = RealRuntime()
        runtime.loop("loop", MS, lambda _: None)

    asyncio.run(run())


def test_a_priority_that_is_not_granted_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("os.sched_setscheduler", refuse)
    assert prepare_thread(50) == "normal scheduling (SCHED_FIFO 50 not granted: Operation not permitted)"
    assert prepare_thread(0) == "normal scheduling (priority 0 configured)"


def test_a_prepared_process_says_what_it_got_and_hands_the_interpreter_over_soon() -> None:
    script = (
        "import sys; from forefeel.common.runtime.realtime import prepare_process; "
        "said = prepare_process(); print(said); print(sys.getswitchinterval())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    said, interval_s = done.stdout.splitlines()
    assert said == "memory locked" or said.startswith("memory not locked (")
    assert float(interval_s) == pytest.approx(SWITCH_INTERVAL_S)


@pytest.mark.skipif(os.geteuid() != 0, reason="SCHED_FIFO needs root")
def test_a_device_thread_goes_before_what_only_computes_and_hands_that_on() -> None:
    found: list[int] = []

    def inner() -> None:
        found.append(os.sched_getparam(0).sched_priority)

    def outer() -> None:
        go_before(10)
        found.append(os.sched_getparam(0).sched_priority)  # normal scheduling stays what it is
        prepare_thread(30)
        go_before(10)
        thread = threading.Thread(target=inner)
        thread.start()
        thread.join()

    thread = threading.Thread(target=outer)
    thread.start()
    thread.join()
    assert found == [0, 40]
