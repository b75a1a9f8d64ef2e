"""Threads of a daemon under Linux and CPython: faults, the interpreter, what is granted."""

import asyncio
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.runtime.real import HOST, RealRuntime
from forefeel.common.runtime.realtime import SWITCH_INTERVAL_S, go_before, prepare_thread
from tests.waiting import PATIENCE_S

MS = 1_000_000


@pytest.fixture(autouse=True)
def process_as_it_is(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Locked memory, a frozen heap and a short interval would last for the rest of the test run."""
    monkeypatch.setattr(HOST, "prepare_process", lambda: "memory as it was")
    interval_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval_s)


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - what is waited for happens in another thread
            await asyncio.sleep(0.001)


def test_fault_of_a_loop_ends_the_daemon_and_no_thread_stays() -> None:
    ticks, threads = list[int](), set[str]()

    def fail(_now_ns: int) -> None:
        threads.add(threading.current_thread().name)
        raise ValueError("torn")

    async def run() -> RealRuntime:
        runtime = RealRuntime()
        runtime.loop("bad", MS, fail)
        runtime.loop("good", MS, ticks.append)
        async with runtime:
            await until(runtime.stopping.is_set)
            after = len(ticks)
            await until(lambda: len(ticks) > after + 3)
        return runtime

    with pytest.raises(RunError, match="ValueError: torn"):
        asyncio.run(run()).raise_fault()
    assert threads == {"bad"}
    assert not {"bad", "good", "timers"} & {thread.name for thread in threading.enumerate()}


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
def test_threads_that_were_started_before_are_raised_take_turns_and_hand_that_on() -> None:
    script = (
        "import os, threading; from forefeel.common.runtime.realtime import raise_threads\n"
        "waiting = threading.Event(); threading.Thread(target=waiting.wait).start(); raise_threads(30)\n"
        "threading.Thread(target=waiting.wait).start()\n"
        "for t in map(int, os.listdir('/proc/self/task')):\n"
        "    print(os.sched_getparam(t).sched_priority, os.sched_getscheduler(t) == os.SCHED_RR)\n"
        "waiting.set()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["30 True"] * 3


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
