"""What every test gets: repeatable properties, nothing left behind, the folder of measured recordings."""

import asyncio
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path

import pytest
from hypothesis import settings

from forefeel.__main__ import main
from forefeel.common.runtime.real import HOST

signal.signal(signal.SIGINT, signal.default_int_handler)  # of which that import has made the system's

settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("repeatable")

_GRACE_S = 1.0
_states = count()


def pytest_collection_finish() -> None:
    """What was imported stays, so the garbage collector need not look at it: 8 % of the time of all tests."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


@pytest.fixture(autouse=True)
def nothing_left_behind() -> Iterator[None]:
    """Fails a test whose threads still run a second after it, or whose event loop ended with tasks in it."""
    threads, tasks = set(threading.enumerate()), list[str]()
    cancel = getattr(asyncio.runners, "_cancel_all_tasks")  # noqa: B009 - what every runner ends with; private

    def noted(loop: asyncio.AbstractEventLoop) -> None:
        tasks.extend(task.get_name() for task in asyncio.all_tasks(loop))
        cancel(loop)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(asyncio.runners, "_cancel_all_tasks", noted)
        yield
    left = _still_running(threads)
    if left or tasks:
        pytest.fail(f"left behind: threads {left}, asyncio tasks {tasks}", pytrace=False)


def _still_running(before: set[threading.Thread]) -> list[str]:
    deadline = time.monotonic() + _GRACE_S
    while (left := _new_threads(before)) and time.monotonic() < deadline:
        left[0].join(0.01)
    return [thread.name for thread in left]


def _new_threads(before: set[threading.Thread]) -> list[threading.Thread]:
    """A foreign thread that once called Python is listed for ever, so it does not count."""
    new = set(threading.enumerate()) - before
    return [thread for thread in new if not isinstance(thread, threading._DummyThread)]


@pytest.fixture(autouse=True)
def no_state_in_the_home(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A daemon that a test starts keeps its state in a folder of that test."""
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / f"state-{next(_states)}"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of the measured recordings."""
    folder = os.environ.get("FOREFEEL_DATA", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("FOREFEEL_DATA names no folder with measured recordings")
    return Path(folder)


@pytest.fixture(autouse=True)
def _scheduled_as_before() -> Iterator[None]:
    """A test that leaves its process under SCHED_FIFO takes the processor from all that come after it."""
    before = os.sched_getscheduler(0)
    yield
    assert os.sched_getscheduler(0) == before, "another scheduling than before the test"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[[Sequence[str]], int]:
    """Runs the command line in this process as the installed script does; its exit code."""
    # what a daemon asks of the operating system would stay with this process
    monkeypatch.setattr(HOST, "prepare_process", lambda: "left alone")
    monkeypatch.setattr(HOST, "prepare_thread", lambda _: "left alone")
    monkeypatch.setattr(HOST, "raise_threads", lambda _: None)
    monkeypatch.setattr("forefeel.__main__._go_first", lambda: None)

    def run(arguments: Sequence[str]) -> int:
        monkeypatch.setattr(sys, "argv", ["forefeel", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code if isinstance(ended.value.code, int) else 0

    return run
