"""The process that serves the page: where it listens, and that nothing of it fails unsaid."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from forefeel.child_process import listening_at
from forefeel.common.errors import EndpointError

ROOT = Path(__file__).parents[3]
BROKEN = """
from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import RunError
from forefeel.dashboard.server import Page
from forefeel.dashboard.sources import LiveCell
from forefeel.child_process import listening_at

async def breaks():
    raise OSError("no process can be started")

with listening_at("127.0.0.1", 0) as listening:
    try:
        Page(listening, LiveCell("cathlab", "", MonotonicClock()), "cell cathlab", []).serve(False, [breaks])
    except RunError as error:
        print(error)
"""


def test_a_part_of_the_page_that_fails_ends_it_and_is_said() -> None:
    pytest.importorskip("nicegui")
    ended = subprocess.run(
        [sys.executable, "-c", BROKEN], cwd=ROOT, capture_output=True, check=True, timeout=60, text=True
    )
    assert ended.stdout.splitlines()[-1] == "dashboard of cell cathlab: OSError: no process can be started"


def test_a_socket_of_the_parent_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as theirs:
        monkeypatch.setenv("FOREFEEL_LISTENING", str(theirs.fileno()))
        with listening_at("127.0.0.1", 8600) as ours:
            assert ours.getsockname() == theirs.getsockname()
            theirs.detach()


def test_why_it_can_not_listen_is_said_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(
            EndpointError, match=rf"--port {port} at 127\.0\.0\.1: Address already in use; exp"
        ):
            listening_at("127.0.0.1", port)

    def unknown(*_: object, **__: object) -> socket.socket:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "create_server", unknown)
    with pytest.raises(EndpointError, match="at nowhere: Name or service not known; expected"):
        listening_at("nowhere", 8600)
