import threading
from functools import partial

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.transport.timers import TimerThread

MS = 1_000_000


class Harness:
    """Timers, the faults they reported, and an event at the last action."""

    def __init__(self) -> None:
        self.clock = MonotonicClock()
        self.faults: list[Exception] = []
        self.done = threading.Event()
        self.timers = TimerThread(self.clock, self.faults.append)
        self.timers.start()

    def finish(self, due_ns: int) -> None:
        self.timers.call_at(due_ns, self.done.set)
        assert self.done.wait(2)
        self.timers.close()


def test_actions_run_in_the_order_of_their_stamps_and_never_early() -> None:
    harness = Harness()
    start = harness.clock.now_ns()
    ran: list[tuple[int, int]] = []

    def note(delay_ms: int) -> None:
        ran.append((delay_ms, harness.clock.now_ns()))

    for delay_ms in (30, 10, 20, 10, 0):
        harness.timers.call_at(start + delay_ms * MS, partial(note, delay_ms))
    harness.finish(start + 40 * MS)
    assert [delay for delay, _ in ran] == [0, 10, 10, 20, 30]
    assert all(stamp >= start + delay * MS for delay, stamp in ran)


def test_equal_stamps_keep_their_order() -> None:
    harness = Harness()
    due = harness.clock.now_ns() + 20 * MS
    ran: list[int] = []
    for number in range(200):
        harness.timers.call_at(due, partial(ran.append, number))
    harness.finish(due)
    assert ran == list(range(200))


def test_median_lateness_is_small() -> None:
    harness = Harness()
    start = harness.clock.now_ns() + 20 * MS
    late: list[int] = []

    def note(due_ns: int) -> None:
        late.append(harness.clock.now_ns() - due_ns)

    for tick in range(100):
        harness.timers.call_at(start + tick * MS, partial(note, start + tick * MS))
    harness.finish(start + 101 * MS)
    assert sorted(late)[50] < 0.5 * MS  # 0.07 ms on an idle machine


def test_a_fault_is_reported_and_later_actions_still_run() -> None:
    harness = Harness()
    now = harness.clock.now_ns()
    harness.timers.call_at(now, partial(divmod, 1, 0))
    harness.finish(now + MS)
    assert [type(fault) for fault in harness.faults] == [ZeroDivisionError]


@pytest.mark.parametrize("started", [True, False])
def test_close_ends_the_thread_and_drops_what_is_not_due(started: bool) -> None:
    clock = MonotonicClock()
    faults: list[Exception] = []
    timers = TimerThread(clock, faults.append)
    if started:
        timers.start()
    ran: list[int] = []
    timers.call_at(clock.now_ns() + 50 * MS, partial(ran.append, 1))
    timers.close()
    timers.close()
    assert not any(thread.name == "timers" for thread in threading.enumerate())
    assert (ran, faults) == ([], [])
