"""Tests of real time: safety is always asserted, timeliness only while the machine was on time, too.

A thread of the test notes how late it is woken. An assertion of timeliness that fails while that thread was
late by half of the assertion's slack or more says nothing of the product. Then it is not judged, and the end
of the run says so; too many of those fail the run.
"""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Self

import pytest

from forefeel.common.messages import SafetyEvent, SafetyState

PRIORITY = 30
"""Of SCHED_FIFO, where it is granted: that of the threads of a daemon that are not its loop."""
WATCHDOG_S = 0.060
"""Of the slave. What needs a session without a stop has this slack: a machine that stands still ends it."""
MOST_NOT_JUDGED = 0.05
"""Of the tests of real time, but one always: of the 14 long ones one is 7 %, and machines stall at times."""
_DEVICE_PRIORITY = 60
"""Of SCHED_RR: that of `forefeel emulate`, above the loops of daemons, which other tests run meanwhile."""
_STEP_S = 0.005
_KEY = "timely"


class Witness:
    """How late a thread was that does nothing but sleep. Attribute `not_judged`: why, of each such assertion.

    Args:
        priority: of SCHED_FIFO, where it is granted; 0: the scheduling of who starts it.
    """

    def __init__(self, priority: int = 0) -> None:
        self.asked = False
        self.not_judged: list[str] = []
        self._latest_s, self._due_s = 0.0, time.monotonic()
        self._priority, self._ended = priority, False
        self._thread = threading.Thread(target=self._run, name="witness")

    def __enter__(self) -> Self:
        self._due_s = time.monotonic()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._thread.join()

    @property
    def late_s(self) -> float:
        """The most so far, also when it still waits to be woken."""
        return max(self._latest_s, time.monotonic() - self._due_s)

    @contextmanager
    def timely(self, slack_s: float) -> Iterator[None]:
        """For assertions of timeliness only: nothing inside may be needed after.

        Args:
            slack_s: how much later than on a machine that is never late they still hold.
        """
        self.asked = True
        try:
            yield
        except AssertionError as error:
            late_s = self.late_s
            if late_s < slack_s / 2:
                raise
            why = (str(error).splitlines() or ["an assertion"])[0]
            self.not_judged.append(f"the machine was late by {1e3 * late_s:.0f} ms: {why}")

    def _run(self) -> None:
        if self._priority:
            with suppress(OSError):  # not granted: the daemons do not have it either
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
        while not self._ended:
            self._due_s = time.monotonic() + _STEP_S
            time.sleep(_STEP_S)
            self._latest_s = max(self._latest_s, time.monotonic() - self._due_s)


def go_ahead() -> None:
    """Lets this process, and what it starts, keep time as a real device does, where it is granted.

    All of its threads: one that is behind, with the interpreter lock in its hands, would stop all others.
    """
    _schedule(os.SCHED_RR, _DEVICE_PRIORITY)


def go_back() -> None:
    """Ends `go_ahead`."""
    _schedule(os.SCHED_OTHER, 0)


def _schedule(policy: int, priority: int) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with suppress(PermissionError, ProcessLookupError):
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))


@contextmanager
def as_other_work() -> Iterator[None]:
    """For the start of a process: it goes ahead by itself, or its imports would keep all others waiting."""
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, priority)


def check_stops(events: list[SafetyEvent]) -> None:
    """Safety, however late anything was: each stop says why, and ends at rest or in what is worse.

    Events are dropped where who listens is late; what came after one that is missing is not known.
    """
    for event in events:
        assert event.reason
        leaves = event.before in {SafetyState.ENGAGING, SafetyState.ARMED}
        assert not (leaves and event.after in {SafetyState.READY, SafetyState.IDLE}), (
            f"no stop before {event}"
        )
    for stop, then in pairwise(events):
        if stop.after is SafetyState.STOPPING and then.sequence == stop.sequence + 1:
            assert then.after in {SafetyState.READY, SafetyState.FAULT, SafetyState.ESTOPPED}, events


class _Account:
    """Gathers from all processes of a run what was not judged."""

    def __init__(self) -> None:
        self._found: dict[str, list[str]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """The report of the end of a test has what its fixtures left."""
        if report.when != "teardown":
            return
        if "realtime" in report.keywords:
            self._found.setdefault(report.nodeid, [])
        for name, said in report.user_properties:
            if name == _KEY and isinstance(said, list):
                self._found[report.nodeid] = [*self._found.get(report.nodeid, []), *said]

    @property
    def _late(self) -> dict[str, list[str]]:
        return {nodeid: said for nodeid, said in self._found.items() if said}

    @property
    def _too_many(self) -> bool:
        return len(self._late) > max(1.0, MOST_NOT_JUDGED * len(self._found))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Turns a passed session into a failed one."""
        if self._too_many and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Says how often and which."""
        if not self._found:
            return
        on_time, failed = len(self._found) - len(self._late), "FAILED " if self._too_many else ""
        terminalreporter.write_line(
            f"{failed}timeliness: judged in {on_time} of {len(self._found)} tests; "
            f"at most one or {MOST_NOT_JUDGED:.0%} may go without"
        )
        for nodeid, said in self._late.items():
            terminalreporter.write_line(f"NOT JUDGED {nodeid}: {'; '.join(said)}")


def pytest_configure(config: pytest.Config) -> None:
    """Every run keeps account."""
    config.pluginmanager.register(_Account(), "timeliness")


def _bears(request: pytest.FixtureRequest, priority: int) -> Iterator[Witness]:
    with Witness(priority) as found:
        yield found
    if found.asked:
        request.node.user_properties.append((_KEY, found.not_judged))


@pytest.fixture
def witness(request: pytest.FixtureRequest) -> Iterator[Witness]:
    """For what is done in the process of the test."""
    yield from _bears(request, 0)


@pytest.fixture
def witness_of_daemons(request: pytest.FixtureRequest) -> Iterator[Witness]:
    """For what is done in daemons, which ask for SCHED_FIFO."""
    yield from _bears(request, PRIORITY)
