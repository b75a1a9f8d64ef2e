"""Slave and master on two hosts: network namespaces of this machine, joined by a cable that can be cut."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
import yaml

from common.recording.mcap_reader import Run, read_run
from common.topics import FORCE, HAPTICS, SAFETY_EVENT, SLAVE_STATE

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy" / "config"
S = 1_000_000_000
WATCHDOG_S = 0.060

pytestmark = [
    pytest.mark.root,
    pytest.mark.skipif(os.geteuid() != 0, reason="making network namespaces needs root"),
    pytest.mark.skipif(shutil.which("ip") is None, reason="making network namespaces needs iproute2"),
]


def ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr.strip()}"


class Hosts:
    """Two hosts, 10.77.0.1 and 10.77.0.2, and the processes on them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names = [f"ff{os.getpid()}{end}" for end in "ab"]
        self._processes: list[subprocess.Popen[bytes]] = []

    def join(self) -> None:
        for name in self.names:
            ip("netns", "add", name)
        a, b = self.names
        ip("link", "add", a, "netns", a, "type", "veth", "peer", "name", b, "netns", b)
        for number, name in enumerate(self.names, 1):
            ip("-n", name, "address", "add", f"10.77.0.{number}/24", "dev", name)
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", name, "up")

    def cut(self) -> None:
        ip("-n", self.names[1], "link", "set", self.names[1], "down")

    def mend(self) -> None:
        ip("-n", self.names[1], "link", "set", self.names[1], "up")

    def run(self, host: int, log: str, *arguments: str) -> "subprocess.Popen[bytes]":
        """A process of ours on that host; `ip netns exec` becomes it."""
        command = ["ip", "netns", "exec", self.names[host], sys.executable, "-m", "forefeel", *arguments]
        with (self.folder / log).open("wb") as words:
            process = subprocess.Popen(
                command,
                cwd=self.folder,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                stdin=subprocess.DEVNULL,
                stdout=words,
                stderr=words,
            )
        self._processes.append(process)
        return process

    def wait_until(self, condition: Callable[[], object], timeout_s: float = 15.0) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline_s, [log.read_text() for log in self.folder.glob("*.log")]
            assert all(process.poll() is None for process in self._processes), "one has ended"
            time.sleep(0.1)

    def says(self, log: str, text: str) -> bool:
        return text in (self.folder / log).read_text()

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()
        for name in self.names:  # its devices go with it
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


@pytest.fixture
def hosts(tmp_path: Path) -> Iterator[Hosts]:
    hosts = Hosts(tmp_path)
    try:
        hosts.join()
        yield hosts
    finally:
        hosts.close()
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert not [name for name in hosts.names if name in left]


def configure(folder: Path) -> None:
    """The files of deploy/, with the addresses of these hosts."""
    slave = yaml.safe_load((DEPLOY / "slave.yaml").read_text())
    master = yaml.safe_load((DEPLOY / "master.yaml").read_text())
    slave["transport"] = {"listen": ["tcp/10.77.0.1:7447"]}
    master["transport"] = {"listen": ["tcp/10.77.0.2:7448"], "connect": ["tcp/10.77.0.1:7447"]}
    for role, settings in (("slave", slave), ("master", master)):
        (folder / f"{role}.yaml").write_text(yaml.safe_dump(settings))


def states(path: Path) -> list[str]:
    """The slave's states, one after the other, in the recording as far as it was flushed, once a second."""
    if not path.exists() or path.stat().st_size == 0:
        return []
    run = read_run(path)
    found = [m.state.value for m in run.messages("insertion", SLAVE_STATE)] if run.axes else []
    return [state for state, _ in groupby(found)]


def test_a_cut_cable_stops_the_slave_and_a_mended_one_brings_everything_back(hosts: Hosts) -> None:
    configure(hosts.folder)
    recording = hosts.folder / "run.mcap"
    slave = hosts.run(0, "slave.log", "slave", "--config", "slave.yaml")
    cell = ["--cell", "cathlab", "--connect", "tcp/10.77.0.1:7447", "--connect", "tcp/10.77.0.2:7448"]
    recorder = hosts.run(0, "record.log", "record", "--out", "run.mcap", *cell)
    master = hosts.run(1, "master.log", "master", "--config", "master.yaml")
    hosts.wait_until(lambda: hosts.says("master.log", "session open"))
    hosts.wait_until(lambda: "armed" in states(recording))
    time.sleep(0.5)
    cut_s = time.monotonic()
    hosts.cut()
    hosts.wait_until(lambda: hosts.says("master.log", "waiting for the slave"))
    hosts.wait_until(lambda: states(recording)[-1] == "idle")
    hosts.mend()
    mended_s = time.monotonic()
    hosts.wait_until(lambda: states(recording)[-1] == "armed")
    time.sleep(1.0)
    for process in (master, slave, recorder):
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    assert hosts.says("master.log", "session open again")
    run = read_run(recording)
    assert not run.truncated
    check_outage(run, cut_s, mended_s)


def check_outage(run: Run, cut_s: float, mended_s: float) -> None:
    after = [(m.stamp_ns / S, m.event) for m in run.messages("insertion", SAFETY_EVENT)]
    names = [event for _, event in after]
    stop = names.index("watchdog")
    assert names[stop : stop + 3] == ["watchdog", "at_rest", "session_lost"]
    stopped_s, lost_s = after[stop][0], after[stop + 2][0]
    assert cut_s < stopped_s < cut_s + WATCHDOG_S + 0.2  # `ip` itself takes some of it
    assert lost_s < cut_s + 1.0 + 0.3
    stamps_s = run.column("insertion", FORCE, "stamp_ns") / S
    still = (stamps_s > stopped_s + 0.2) & (stamps_s < mended_s)
    position_m = run.column("insertion", FORCE, "position_m")
    assert still.sum() > 500
    assert position_m[still].max() - position_m[still].min() <= 2e-6
    again_s = next(time_s for time_s, event in after[stop:] if event == "engaged")
    answers = run.column("insertion", FORCE, "answers_sequence")
    assert (answers[stamps_s > again_s] > 0).sum() > 100
    ticks_s = run.column("insertion", HAPTICS, "stamp_ns") / S
    for start_s, end_s in ((cut_s - 0.5, cut_s), (again_s + 0.2, ticks_s[-1] - 0.5)):
        delays_s = run.column("insertion", HAPTICS, "delay_s")[(ticks_s > start_s) & (ticks_s < end_s)]
        assert len(delays_s) > 100
        assert 0 < np.median(delays_s) < 0.020
