"""Both daemons as processes over real Zenoh, and what becomes of one when the other dies."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
import yaml
import zenoh

from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import decode
from forefeel.common.messages import Message
from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.common.topics import (
    BY_NAME,
    COMMAND,
    FORCE,
    HAPTICS,
    MASTER_IMPAIRMENT,
    MASTER_STATE,
    RECORDED,
    SAFETY_EVENT,
    SLAVE_IMPAIRMENT,
    SLAVE_STATE,
    Topic,
)
from forefeel.common.transport.settings import PRESETS, TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.real import run_real
from tests.waiting import PATIENCE_S, wait_until
from tests.witness import WATCHDOG_S, Witness, check_stops

ROOT = Path(__file__).parents[2]
CELL = "forefeel/cell/insertion"
M = TypeVar("M", bound=Message)
S = 1_000_000_000


def free_endpoint() -> str:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def alive(pid: int) -> bool:
    """Whether the process runs; one that ended and whom nobody buried does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def children(pid: int) -> list[int]:
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []


class Daemon:
    """One process of ours and its words."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.log = folder / f"{len(list(folder.iterdir()))}.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "forefeel", *arguments],
                cwd=folder,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def says(self, text: str) -> bool:
        return text in self.log.read_text()

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self, number: signal.Signals) -> tuple[int, str]:
        """Exit code after that signal, and the last line."""
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S), self.log.read_text().splitlines()[-1]

    def resident_mb(self) -> float:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024


class Cell:
    """Starts the ends of one cell and hears them; nothing of it is left at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.slave_endpoint, own = free_endpoint(), free_endpoint()
        self.heard: list[tuple[str, bytes]] = []
        self.faults: list[Exception] = []
        self.started: list[Daemon] = []
        self._session = ZenohTransport.open(
            TransportSettings(listen=(own,)), MonotonicClock(), self.faults.append
        )
        self._session.subscribe_all("forefeel", lambda key, payload, _: self.heard.append((key, payload)))
        link = {"inbound": "lan", "seed": 1}
        self._write("slave", {"listen": [self.slave_endpoint], "connect": [own]}, link)
        self._write("master", {"connect": [self.slave_endpoint, own]}, link)

    def _write(self, role: str, transport: dict[str, Any], link: dict[str, Any]) -> None:
        text = yaml.safe_dump({"role": role, "transport": transport, "impairment": link})
        (self.folder / f"{role}.yaml").write_text(text)

    def run(self, *arguments: str) -> Daemon:
        daemon = Daemon(self.folder, *arguments)
        self.started.append(daemon)
        return daemon

    def slave(self) -> Daemon:
        return self.run("slave", "--config", "slave.yaml")

    def master(self) -> Daemon:
        return self.run("master", "--config", "master.yaml")

    def pair(self) -> tuple[Daemon, Daemon]:
        """Slave and master, armed."""
        ends = self.slave(), self.master()
        self.wait_for("armed")
        # on its way beside the state: whoever counts the events that follow has heard it
        wait_until(lambda: "engaged" in self.events())
        return ends

    def wait_for(self, state: str) -> float:
        """Until the slave says that it is in that state, from now on."""
        self.heard.clear()
        asked_ns = time.monotonic_ns()  # what was sent before may still arrive

        def reached() -> bool:
            return state in {m.state for m in self.messages(SLAVE_STATE) if m.stamp_ns > asked_ns}

        try:
            return wait_until(reached)
        except AssertionError as error:
            raise AssertionError(f"not {state}: {[d.log.read_text() for d in self.started]}") from error

    def messages(self, topic: Topic[M]) -> list[M]:
        return [decode(topic.message, p) for key, p in list(self.heard) if key == f"{CELL}/{topic.name}"]

    def events(self) -> list[str]:
        return [message.event for message in self.messages(SAFETY_EVENT)]

    def wait_for_rest(self) -> None:
        """Until the slave follows nobody; that each stop on the way was orderly is checked."""
        wait_until(lambda: {m.state for m in self.messages(SLAVE_STATE)[-1:]} & {"ready", "idle"})
        check_stops(self.messages(SAFETY_EVENT))

    def close(self) -> None:
        for daemon in self.started:
            if daemon.process.poll() is None:
                daemon.process.kill()
            daemon.process.wait()
        self._session.close()


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    before, cell = children(os.getpid()), Cell(tmp_path)
    yield cell
    cell.close()
    assert cell.faults == []
    assert set(children(os.getpid())) <= set(before)


def test_a_loopback_run_is_recorded_from_the_first_message_to_the_last(
    tmp_path: Path, witness: Witness, witness_of_daemons: Witness
) -> None:
    before = children(os.getpid())
    shown: list[tuple[float, str]] = []
    run_real(
        make_plan(LoopbackOptions(seed=1, impairment="paper", duration_s=4.0)),
        tmp_path,
        lambda done_s, what: shown.append((done_s, what)),
    )
    run = read_run(tmp_path / "recording.mcap")
    assert not run.truncated
    assert run.metadata["run"]["impairment"] == "paper"
    rare = {"any/estop", "slave/limit", "slave/calibration"}
    counts = {topic.name: run.count("insertion", topic) for topic in RECORDED}
    events = list(run.messages("insertion", SAFETY_EVENT))
    check_stops(events)
    with witness_of_daemons.timely(WATCHDOG_S):
        check_pace(run)
        assert [name for name, count in counts.items() if not count and name not in rare] == []
        names = [event.event for event in events]
        assert names == ["session_opened", "engage", "engaged", "release", "at_rest"]
    for trace in (MASTER_IMPAIRMENT, SLAVE_IMPAIRMENT):
        chunks = list(run.messages("insertion", trace))
        planned = [delays_ns for chunk in chunks for delays_ns in chunk.delays_ns]
        with witness_of_daemons.timely(WATCHDOG_S):  # a late machine drops what comes once a second
            assert [chunk.first_index for chunk in chunks][:1] == [0]
            assert sum(not delay_ns for delay_ns in planned) / len(planned) == pytest.approx(0.01, abs=0.01)
    with witness.timely(1.0):  # this process has no priority, and daemons of other tests may take both cores
        assert {"starting", "armed"} <= {what for _, what in shown}
        assert max(done_s for done_s, _ in shown) > 3.0
    assert set(children(os.getpid())) <= set(before)


def check_pace(run: Run) -> None:
    """1 kHz from the first message on, and the delay that was asked for."""
    sequences = run.column("insertion", COMMAND, "sequence")
    assert sequences[-1] > 3000
    assert len(sequences) > 0.97 * sequences[-1]  # a busy host may drop some
    for stream in ("master/command", "master/haptics", "slave/force"):
        assert run.column("insertion", BY_NAME[stream], "sequence")[0] < 50
    delay_s = np.nanmedian(run.column("insertion", HAPTICS, "delay_s"))
    assert delay_s == pytest.approx(2 * PRESETS["paper"].delay_s, abs=0.025)
    for trace in (MASTER_IMPAIRMENT, SLAVE_IMPAIRMENT):
        assert sum(len(chunk.delays_ns) for chunk in run.messages("insertion", trace)) > 3000


@pytest.mark.soak
def test_both_ends_start_quickly_and_stay_small(cell: Cell, witness: Witness) -> None:
    slave = cell.slave()
    took_s = wait_until(lambda: slave.says("waiting for a master"))
    with witness.timely(5.0):
        assert took_s < 10
    master = cell.master()
    cell.wait_for("armed")
    assert slave.resident_mb() < 150
    assert master.resident_mb() < 250  # it carries the compiled predictor


def test_the_slave_stops_when_the_master_is_killed_and_a_new_one_takes_over(
    cell: Cell, witness_of_daemons: Witness
) -> None:
    _, master = cell.pair()
    cell.heard.clear()
    master.send(signal.SIGKILL)
    killed_ns = time.monotonic_ns()
    wait_until(lambda: {m.state for m in cell.messages(SLAVE_STATE)[-1:]} == {"idle"})
    check_stops(cell.messages(SAFETY_EVENT))
    with witness_of_daemons.timely(WATCHDOG_S):
        wait_until(lambda: "session_lost" in cell.events(), 5.0)
        events = cell.messages(SAFETY_EVENT)
        assert [event.event for event in events] == ["watchdog", "at_rest", "session_lost"]
        stopped, rested, _ = events
        assert stopped.before == "armed"
        assert (stopped.stamp_ns - killed_ns) / S < 0.060 + 0.1
        assert (rested.stamp_ns - stopped.stamp_ns) / S < 0.2 / 4.0 + 0.1
    cell.master()
    cell.wait_for("armed")
    assert cell.messages(SLAVE_STATE)[-1].stops >= 1


def test_the_master_waits_visibly_when_the_slave_is_killed_and_works_with_a_new_one(
    cell: Cell, witness_of_daemons: Witness
) -> None:
    slave, master = cell.pair()
    slave.send(signal.SIGKILL)
    lost = re.compile(r"no state from the slave for (\d+\.\d) s; waiting for the slave")
    wait_until(lambda: lost.search(master.log.read_text()))
    with witness_of_daemons.timely(0.9):
        assert 1.0 <= float(lost.findall(master.log.read_text())[0]) < 2.0
    lost_ns = time.monotonic_ns()  # what was sent before may still arrive
    wait_until(lambda: cell.messages(MASTER_STATE)[-1].stamp_ns > lost_ns)
    state = cell.messages(MASTER_STATE)[-1]
    assert (state.indication, state.deadman) == ("no_session", False)
    assert all(each.stamp_ns < lost_ns for each in cell.messages(COMMAND))
    cell.slave()
    cell.wait_for("armed")
    assert master.says("session open again")
    assert master.process.poll() is None


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.soak)])
def test_each_end_ends_in_order_the_master_first(
    cell: Cell, number: signal.Signals, witness_of_daemons: Witness
) -> None:
    slave, master = cell.pair()
    for end, who in ((slave, "slave: axis insertion: "), (master, "master: axis insertion: slave ")):
        wait_until(lambda end=end, who=who: end.says(f"{who}engaging -> armed, engaged: ramp done"))  # type: ignore[misc]
    assert slave.says("slave: axis insertion: session open")
    cell.heard.clear()
    assert master.end(number) == (0, "master: handle released, closed")
    cell.wait_for_rest()
    with witness_of_daemons.timely(WATCHDOG_S):
        assert cell.events()[:2] == ["release", "at_rest"]
        assert slave.says("armed -> stopping, release: deadman released")
    assert slave.end(number) == (0, "slave: stage at rest, closed")


def test_a_slave_that_ends_while_armed_comes_to_rest_first(cell: Cell, witness_of_daemons: Witness) -> None:
    slave, master = cell.pair()
    cell.heard.clear()
    assert slave.end(signal.SIGTERM) == (0, "slave: stage at rest, closed")
    with witness_of_daemons.timely(WATCHDOG_S):
        wait_until(lambda: "at_rest" in cell.events(), 5.0)
        assert cell.events()[:2] == ["shutdown", "at_rest"]
    check_stops(cell.messages(SAFETY_EVENT))
    assert master.process.poll() is None
    assert master.end(signal.SIGINT) == (0, "master: handle released, closed")


@pytest.mark.soak
def test_a_viewer_that_sleeps_disturbs_nobody(cell: Cell, witness_of_daemons: Witness) -> None:
    cell.pair()
    viewed: list[None] = []
    awake = threading.Event()

    def doze(_sample: zenoh.Sample) -> None:
        viewed.append(None)
        awake.wait(0.1)

    config = zenoh.Config()
    config.insert_json5("connect/endpoints", f"['{cell.slave_endpoint}']")
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber("forefeel/**", doze)
        wait_until(lambda: viewed)
        cell.heard.clear()
        time.sleep(1.2)
        forces, commands = cell.messages(FORCE), cell.messages(COMMAND)
        state = cell.messages(SLAVE_STATE)[-1]
        assert len(viewed) < 30
        awake.set()
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    with witness_of_daemons.timely(WATCHDOG_S):
        for sequences in ([m.sequence for m in forces], [m.sequence for m in commands]):
            assert len(sequences) > 900
            assert len(sequences) >= 0.9 * (sequences[-1] - sequences[0] + 1)  # stalled: nearly none
    ages_s = [(m.stamp_ns - m.answers_stamp_ns) / S for m in forces if m.answers_stamp_ns is not None]
    with witness_of_daemons.timely(WATCHDOG_S):
        assert len(ages_s) == len(forces)
        assert state.state == "armed"
    with witness_of_daemons.timely(0.005):
        assert np.median(ages_s) < 0.005


@pytest.fixture
def loopback(tmp_path: Path) -> Iterator[Daemon]:
    """The command `forefeel loopback` for far too long."""
    parent = Daemon(tmp_path, "loopback", "--duration", "100", "--out", "out")
    ends: list[int] = []
    try:
        wait_until(lambda: len(children(parent.process.pid)) == 2)
        ends += children(parent.process.pid)
        yield parent
    finally:
        parent.process.kill()
        parent.process.wait()
        for pid in filter(alive, ends):
            os.kill(pid, signal.SIGKILL)


def running(parent: Daemon) -> bool:
    log = parent.log.parent / "out" / "master.log"
    return log.exists() and "session open" in log.read_text()


@pytest.mark.soak
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_loopback_ends_both_and_leaves_its_recording(
    loopback: Daemon, tmp_path: Path, number: signal.Signals
) -> None:
    wait_until(lambda: running(loopback))
    time.sleep(1.0)
    ends = children(loopback.process.pid)
    loopback.send(number)
    time.sleep(0.05)
    loopback.send(number)  # of an impatient person
    code, last = loopback.process.wait(PATIENCE_S), loopback.log.read_text().splitlines()[-1]
    assert code == 1
    assert last == "forefeel: interrupted; both ends stopped in order and the recording is closed"
    assert "Traceback" not in loopback.log.read_text()
    assert not any(map(alive, ends))
    assert (tmp_path / "out" / "slave.log").read_text().endswith("slave: stage at rest, closed\n")
    run = read_run(tmp_path / "out" / "recording.mcap")
    assert not run.truncated
    assert run.count("insertion", FORCE) > 500


@pytest.mark.soak
@pytest.mark.parametrize("when", ["at once", "while it runs"])
def test_a_loopback_that_is_killed_leaves_no_orphan(loopback: Daemon, tmp_path: Path, when: str) -> None:
    if when == "while it runs":
        wait_until(lambda: running(loopback))
        time.sleep(1.2)  # the recorder flushes once a second
    ends = children(loopback.process.pid)
    assert len(ends) == 2
    loopback.send(signal.SIGKILL)
    wait_until(lambda: not any(map(alive, ends)))
    if when == "while it runs":
        run = read_run(tmp_path / "out" / "recording.mcap")
        assert run.truncated
        assert run.count("insertion", FORCE) > 100
