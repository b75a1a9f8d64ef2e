"""What the daemons tell systemd, by a socket of its kind."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.witness import Witness

ROOT = Path(__file__).parents[2]
PATIENCE_S = 30.0


class Systemd:
    """Starts one daemon as systemd would and hears what it says."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.heard: list[str] = []
        self._receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._receiver.bind(str(folder / "notify"))
        self._receiver.settimeout(0.1)
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": "400000",
            "XDG_STATE_HOME": str(folder / "state"),
        }
        environment.pop("WATCHDOG_PID", None)
        command = [sys.executable, "-m", "forefeel", *words]
        self.process = subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.DEVNULL)

    def listen(self, seconds: float) -> list[str]:
        """What is said in that time."""
        said, deadline_s = list[str](), time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            try:
                said.append(self._receiver.recv(4096).decode())
            except TimeoutError:
                continue
        self.heard += said
        return said

    def wait_for(self, text: str) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not any(text in said for said in self.heard):
            assert time.monotonic() < deadline_s, f"{text!r} not said: {self.heard}"
            self.listen(0.1)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._receiver.close()


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[Systemd]:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    (tmp_path / "slave.yaml").write_text(f"role: slave\ntransport: {{listen: ['{endpoint}']}}\n")
    found = Systemd(tmp_path, "slave", "--config", "slave.yaml")
    yield found
    found.close()


def test_a_slave_says_that_it_is_ready_how_it_does_and_that_it_ends(
    slave: Systemd, witness_of_daemons: Witness
) -> None:
    slave.wait_for("WATCHDOG=1")
    assert slave.heard.count("READY=1") == 1
    assert "STATUS=axis insertion: idle (started)" in slave.heard
    said = slave.listen(1.0)
    with witness_of_daemons.timely(0.2):
        assert said.count("WATCHDOG=1") >= 4
    slave.process.send_signal(signal.SIGTERM)
    slave.wait_for("STOPPING=1\nSTATUS=stopping")
    assert slave.process.wait(PATIENCE_S) == 0


@pytest.mark.soak
def test_a_slave_that_is_stopped_gives_no_sign_of_life(slave: Systemd) -> None:
    slave.wait_for("WATCHDOG=1")
    slave.process.send_signal(signal.SIGSTOP)
    slave.listen(0.2)
    assert slave.listen(0.8) == []
