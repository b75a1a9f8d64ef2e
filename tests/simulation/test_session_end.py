"""A master that ends: its last events, and the armed share of a recording that goes on."""

import re
from pathlib import Path

import pytest

from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import MASTER_LIMIT, MASTER_STATE, parse_key
from forefeel.report.model import RunReport
from forefeel.report.summary import summarise
from tests.simulation.pair import Pair, S


def reported(pair: Pair, path: Path) -> RunReport:
    with RunWriter(path) as writer:
        for key, payload, stamp_ns in pair.traffic.payloads:
            parsed = parse_key(key)
            if parsed is not None and parsed[2].recorded:
                writer.write(key, payload, stamp_ns)
    return summarise(Run(path))


@pytest.mark.parametrize("orderly", [True, False])
def test_the_armed_time_ends_with_the_master_and_that_it_was_killed_is_noted(
    tmp_path: Path, orderly: bool
) -> None:
    pair = Pair()
    pair.run(2.5)
    if orderly:  # as in real time, it says for 0.3 s that it has let go
        pair.master.shut_down()
        pair.run(0.3)
        pair.master.close(pair.runtime.clock.now_ns())
    else:
        pair.master.transport.close()
    pair.run(2.0)
    report = reported(pair, tmp_path / "run.mcap")
    assert report.duration_s > 4.4
    assert report.armed_share == 1.0
    assert report.stops == (0 if orderly else 1)
    notes = [
        float(seconds) for note in report.notes for seconds in re.findall(r"heard last at (\S+) s", note)
    ]
    assert notes == ([] if orderly else pytest.approx([2.45], abs=0.06))


def test_every_limit_of_the_force_is_counted_by_an_event_when_the_master_has_ended() -> None:
    pair = Pair(master={"axes": [{"rendering": {"max_force_n": 0.01, "max_slew_n_s": 1.0}}]})
    pair.run(2.093)  # amid a stroke, and 93 ms after events were due
    before = sum(event.count for event in pair.traffic.messages(MASTER_LIMIT))
    pair.master.close(pair.runtime.clock.now_ns())
    limited = pair.traffic.messages(MASTER_STATE)[-1].counters["force_limited"]
    assert 0 < before < limited, f"in {pair.runtime.clock.now_ns() / S} s"
    assert sum(event.count for event in pair.traffic.messages(MASTER_LIMIT)) == limited
