"""A cell of real daemons over mutual TLS: motion and force, watchdog, latched stop."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

import forefeel as ff
from forefeel.common.topics import FORCE, HAPTICS, SAFETY_EVENT
from tests.live_cell import AXIS, CELL, LiveCell, check_stops
from tests.waiting import PATIENCE_S, wait_until


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[LiveCell]:
    with LiveCell(tmp_path, pki=True) as cell:
        yield cell
    assert cell.faults == []


def test_session_moves_stage_and_renders_force(cell: LiveCell) -> None:
    slave, master = cell.pair()

    def moved_in_contact() -> bool:
        forces = [m for m in cell.messages(FORCE) if m.valid and m.answers_sequence is not None]
        rendered_n = [m.rendered_n for m in cell.messages(HAPTICS)]
        return (
            len(forces) > 100
            and float(np.ptp([m.position_m for m in forces])) > 0.003
            and float(np.ptp([m.force_n for m in forces])) > 0.03
            and float(np.ptp(rendered_n or [0.0])) > 0.03
        )

    wait_until(moved_in_contact, every_s=0.3)
    master.send(signal.SIGTERM)
    assert master.wait() == 0
    wait_until(lambda: cell.newest_after(0) in {"ready", "idle"})
    slave.send(signal.SIGTERM)
    assert slave.wait() == 0
    assert "stage at rest" in slave.text
    check_stops(cell.messages(SAFETY_EVENT))


def test_killed_master_stops_slave_until_another_comes(cell: LiveCell) -> None:
    _, master = cell.pair()
    master.kill()
    cell.await_state("idle")
    from_ns = time.monotonic_ns()
    wait_until(lambda: len(cell.since(FORCE, from_ns)) > 300, every_s=0.1)
    forces = cell.since(FORCE, from_ns)
    assert all(message.answers_sequence is None for message in forces)
    assert np.ptp([message.position_m for message in forces]) < 5e-6
    check_stops(cell.messages(SAFETY_EVENT))
    cell.start("master")
    cell.await_state("armed")


def test_stop_during_an_investigation_leaves_a_recording_and_no_verdict(cell: LiveCell) -> None:
    cell.start("slave").wait_for("listening")
    words = ("investigate", "--config", "master.yaml", "--yes", "--out", "asked")
    investigation = cell.start("investigate", *words)

    def sweeps() -> bool:
        """True once the mirrored motion is played, not only the way to its beginning."""
        return any((sample.recording_time_s or 0.0) > 1.0 for sample in cell.messages(FORCE)[-300:])

    wait_until(sweeps, every_s=0.2)
    stop = cell.start("estop", "estop", "--config", "master.yaml")
    assert stop.wait() == 0, stop.text
    assert investigation.wait() == 1
    assert "no verdict" in investigation.text and "estopped" in investigation.text, investigation.text
    made = ff.load(cell.folder / "asked" / "question.mcap")
    assert made.force_n is not None and np.ptp(made.position_m) > 1e-3
    assert not list((cell.folder / "asked").glob("answer.*"))
    check_stops(cell.messages(SAFETY_EVENT))


def test_emergency_stop_outlives_kill_until_cleared(cell: LiveCell) -> None:
    slave, master = cell.pair()
    words = ("--cell", CELL, "--connect", cell.endpoint, "--pki", "pki", "--reason", "catheter kinked")
    stop = cell.start("estop", "estop", *words)
    assert stop.wait() == 0, stop.text
    cell.await_state("estopped")
    slave.kill()
    master.wait_for("waiting for the slave")
    slave = cell.start("slave")
    slave.wait_for("session open")
    cell.await_state("estopped")
    assert "armed" not in slave.text
    clear = cell.start("clear", "clear", "--config", "slave.yaml")
    assert clear.wait() == 0, clear.text
    cell.await_state("armed")
    ends = [cell.endpoint, cell.master_endpoint]
    viewer = {"role": "viewer", "cell": CELL, "transport": {"connect": ends, "pki": str(cell.pki)}}
    (cell.folder / "viewer.yaml").write_text(yaml.safe_dump(viewer))
    with ff.connect(cell.folder / "viewer.yaml") as seen:
        assert seen.wait(PATIENCE_S) and seen.state and seen.force and seen.prediction
    with ff.connect(cell.folder / "master.yaml") as seen:
        assert seen.wait(PATIENCE_S) and seen.state and seen.force
        assert seen.stop("enough") == {AXIS: "estopped"}
    check_stops(cell.messages(SAFETY_EVENT))
