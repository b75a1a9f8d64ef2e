"""Unit tests, properties, simulations, devices and commands start nothing and wait for no clock."""

import multiprocessing.process
import os
import re
import subprocess
import threading
import time
from collections.abc import Iterator
from typing import NoReturn

import pytest

FOLDERS = frozenset({"unit", "property", "simulation", "devices", "commands"})
OF_ASYNCIO = re.compile(r"asyncio_|.*\(_do_shutdown\)")
"""Names of the threads of an event loop's executor, and of that which ends it."""

EXEMPT = "unit/test_recording_bombs.py"
"""Measures the memory of a process of its own."""


@pytest.fixture(autouse=True)
def deterministic(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fails a test of these folders that starts a process or a thread of its own, or calls time.sleep."""
    path = request.path.relative_to(request.config.rootpath / "tests")
    if path.parts[0] not in FOLDERS or path.as_posix() == EXEMPT:
        yield
        return
    start = threading.Thread.start

    def refuse(what: str) -> NoReturn:
        pytest.fail(f"{what}: use virtual or stepped time, or move the test to tests/process", pytrace=False)

    def start_thread(thread: threading.Thread) -> None:
        if not OF_ASYNCIO.match(thread.name):
            refuse(f"starts the thread {thread.name}")
        start(thread)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(threading.Thread, "start", start_thread)
        patch.setattr(time, "sleep", lambda _s: refuse("calls time.sleep"))
        for place, name in (
            (subprocess.Popen, "__init__"),
            (multiprocessing.process.BaseProcess, "start"),
            (os, "fork"),
            (os, "posix_spawn"),
        ):
            patch.setattr(place, name, lambda *_, **__: refuse("starts a process"))
        yield
