"""`forefeel loopback` until everything has happened, then Ctrl-C: recording and report."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import FORCE, HAPTICS, RECORDED, SAFETY_EVENT, SLAVE_IMPAIRMENT
from forefeel.common.transport.settings import PRESETS
from tests.live_cell import Process, check_stops
from tests.waiting import PATIENCE_S, wait_until

AXIS = "insertion"
RARE = {"any/estop", "slave/limit", "master/limit", "slave/calibration", "slave/shape"}


def recorded(path: Path) -> Run | None:
    """As far as it was flushed, once a second."""
    if not path.exists() or path.stat().st_size == 0:
        return None
    run = Run(path)
    return run if AXIS in run.axes else None


def moved(run: Run) -> bool:
    """True if the stage has followed a thousand commands: one that is interrupted at the first has no session
    that the master knew to be armed.
    """
    answers = np.isfinite(run.column(AXIS, FORCE, "answers_sequence"))
    answers &= run.column(AXIS, FORCE, "valid").astype(bool)
    moved_m = run.column(AXIS, FORCE, "position_m")[answers]
    return len(moved_m) > 1000 and float(np.ptp(moved_m)) > 20e-6


def missing(run: Run) -> list[str]:
    return [topic.name for topic in RECORDED if not run.count(AXIS, topic) and topic.name not in RARE]


def lost(run: Run) -> int:
    """Messages to the slave that the impairment has dropped."""
    planned_ns = (plan for chunk in run.messages(AXIS, SLAVE_IMPAIRMENT) for plan in chunk.delays_ns)
    return sum(not plan for plan in planned_ns)


def interrupted_run(folder: Path, complete: Callable[[Run], bool], *words: str) -> Run:
    """Of a loopback that ran until its recording was complete."""
    out = folder / "out"
    loopback = Process("loopback", folder, "loopback", "--duration", "600", "--out", "out", *words)

    def done() -> bool:
        assert loopback.running, loopback.text
        run = recorded(out / "recording.mcap")
        return run is not None and run.count(AXIS, FORCE) > 0 and moved(run) and complete(run)

    try:
        wait_until(done, 3 * PATIENCE_S, "motion", every_s=2.0)  # each reads all that was recorded
        loopback.interrupt()
        assert loopback.wait() == 1, loopback.text
        assert "Traceback" not in loopback.text
        wait_until(lambda: not loopback.group_runs(), what="the end of all children")
    finally:
        loopback.kill()
    assert "stage at rest" in (out / "slave.log").read_text()
    run = Run(out / "recording.mcap")
    assert not run.truncated
    check_stops(list(run.messages(AXIS, SAFETY_EVENT)))
    return run


def check_readings(run: Run) -> None:
    """Each of the load cell's is answered once."""
    stamps_ns = [message.stamp_ns for message in run.messages(AXIS, FORCE) if message.valid]
    assert np.all(np.diff(stamps_ns) > 0)


def test_interrupted_loopback_with_impairment_is_reported(tmp_path: Path) -> None:
    words = ("--impairment", "paper", "--seed", "1")
    run = interrupted_run(tmp_path, lambda run: not missing(run) and lost(run) > 0, *words)
    check_readings(run)
    paper = PRESETS["paper"]
    delay_s = np.nanmedian(run.column(AXIS, HAPTICS, "delay_s"))
    assert delay_s >= 2 * (paper.delay_s - paper.jitter_s)
    report = Process("report", tmp_path, "report", "out/recording.mcap", "--out", "pages")
    assert report.wait() == 0, report.text
    assert json.loads((tmp_path / "pages" / "report.json").read_text())["armed_share"] > 0.0
    assert (tmp_path / "pages" / "report.html").read_text().rstrip().endswith("</html>")
