"""The armed share of a recording that goes on when one end is gone."""

from pathlib import Path

import pytest

from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import parse_key
from forefeel.report.model import RunReport
from forefeel.report.summary import summarise
from tests.simulation.pair import Pair


@pytest.fixture
def armed() -> Pair:
    """For about two seconds."""
    pair = Pair()
    pair.run(3.0)
    return pair


def reported(pair: Pair, path: Path) -> RunReport:
    with RunWriter(path) as writer:
        for key, payload, stamp_ns in pair.traffic.payloads:
            parsed = parse_key(key)
            if parsed is not None and parsed[2].recorded:
                writer.write(key, payload, stamp_ns)
    return summarise(Run(path))


def end_master(pair: Pair) -> None:
    """In order, as in real time: it says for 0.3 s that it has let go."""
    pair.master.shut_down()
    pair.run(0.3)
    pair.master.close(pair.runtime.clock.now_ns())


def test_what_is_recorded_after_an_orderly_end_is_not_counted(armed: Pair, tmp_path: Path) -> None:
    end_master(armed)
    armed.run(2.0)
    report = reported(armed, tmp_path / "run.mcap")
    assert report.duration_s > 5.0
    assert report.armed_share == 1.0
    assert report.stops == 0
    assert not any("heard last" in note for note in report.notes)


def test_the_armed_time_ends_with_a_master_that_was_killed_and_that_is_noted(
    armed: Pair, tmp_path: Path
) -> None:
    armed.master.transport.close()
    armed.run(2.0)
    report = reported(armed, tmp_path / "run.mcap")
    assert report.armed_share == 1.0
    assert report.stops == 1
    (note,) = [note for note in report.notes if "heard last" in note]
    assert "heard last at 2.9 s" in note or "heard last at 3.0 s" in note
