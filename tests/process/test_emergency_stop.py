"""An emergency stop from a third process, latched over a kill, cleared at the slave; what is left of it."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.state.folder import EVENTS
from forefeel.common.topics import COMMAND, CONTROL_CYCLE, FORCE, HAPTICS, SAFETY_EVENT
from forefeel.local.client import ask
from forefeel.local.protocol import Request
from forefeel.report.page import make_pages
from tests.event_lines import read_events
from tests.process.test_processes import Cell, Daemon
from tests.waiting import PATIENCE_S, wait_until
from tests.witness import WATCHDOG_S, Witness, check_stops

S = 1_000_000_000


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    cell = Cell(tmp_path)
    for role in ("slave", "master"):
        path = tmp_path / f"{role}.yaml"
        path.write_text(f"{path.read_text()}state: {{directory: {role}-state}}\n")
    yield cell
    cell.close()
    assert cell.faults == []


def ended(daemon: Daemon) -> tuple[int, str]:
    return daemon.process.wait(PATIENCE_S), daemon.log.read_text()


def flights(cell: Cell, role: str) -> list[Path]:
    return sorted((cell.folder / f"{role}-state" / "flight").glob("*.mcap"))


def events(path: Path) -> list[str]:
    return [each.event for each in read_events(path)]


def test_anyone_stops_only_the_slave_s_host_clears_and_all_of_it_is_written_down(
    cell: Cell, witness_of_daemons: Witness
) -> None:
    slave, master = cell.pair()
    time.sleep(2.0)  # as much as a flight record keeps of what was before
    words = ["--cell", "cell", "--connect", cell.slave_endpoint, "--reason", "third"]
    code, text = ended(cell.run("estop", *words))
    assert code == 0, text
    assert "axis insertion: estopped" in text
    check_stops(cell.messages(SAFETY_EVENT))
    cell.wait_for("estopped")
    wait_until(lambda: flights(cell, "slave") and flights(cell, "master"))
    # a kill does not clear it
    slave.send(signal.SIGKILL)
    slave.process.wait()
    again = cell.slave()
    wait_until(lambda: again.says("slave: axes"))  # what the killed one has said may still arrive until then
    cell.wait_for("estopped")
    code, text = ended(cell.run("clear", "--config", "slave.yaml"))
    assert code == 0, text
    assert "cleared estopped: latched before the slave was started: " in text
    cell.wait_for("armed")
    # from the other side, through the master's own socket
    answer = ask(cell.folder / "master-state", Request(do="estop", reason="operator"))
    assert answer.done and answer.text[0].startswith("axis insertion: estopped, ")
    assert master.end(signal.SIGTERM)[0] == 0
    assert again.end(signal.SIGTERM)[0] == 0
    check_what_is_left(cell)
    with witness_of_daemons.timely(WATCHDOG_S):
        check_record(cell)


def check_what_is_left(cell: Cell) -> None:
    noted = events(cell.folder / "slave-state" / EVENTS)
    assert noted.count("start") == 2 and noted.count("stop") == 1
    assert {"emergency_stop", "clear", "session_opened", "flight_record"} <= set(noted)
    assert {"slave_safety", "emergency_stop", "session_lost"} <= set(
        events(cell.folder / "master-state" / EVENTS)
    )
    report, _ = make_pages(read_run(flights(cell, "master")[0]))
    assert report.stops is not None


def check_record(cell: Cell) -> None:
    """Of 1 kHz for 2.5 s about the stop; a busy host may skip some. Stops that a late machine causes take its
    place: there is one record a second, and the newest are kept.
    """
    run = read_run(flights(cell, "slave")[0])
    assert run.metadata["flight"]["event"] == "estop"
    stamps = run.column("insertion", CONTROL_CYCLE, "stamp_ns")
    stop_ns = int(run.metadata["flight"]["stamp_ns"])
    assert stamps[0] < stop_ns - 1.9 * S and stamps[-1] > stop_ns + 0.45 * S
    assert run.count("insertion", CONTROL_CYCLE) > 2000
    assert run.count("insertion", COMMAND) > 1500 and run.count("insertion", FORCE) > 1500
    assert read_run(flights(cell, "master")[0]).count("insertion", HAPTICS) > 1500
