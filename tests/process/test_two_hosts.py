"""Slave and master on two hosts: network namespaces of this machine, joined by a cable that can be cut."""

import signal
import time
from itertools import groupby
from pathlib import Path

import numpy as np

from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.common.topics import FORCE, HAPTICS, SAFETY_EVENT, SLAVE_STATE
from tests.system.net.hosts import joined_by_veth, needs_root
from tests.system.net.service import MASTER_AT, PKI, SLAVE_AT, configure
from tests.witness import Witness, check_stops

S = 1_000_000_000
WATCHDOG_S = 0.060

pytestmark = needs_root


def states(path: Path) -> list[str]:
    """The slave's states, one after the other, in the recording as far as it was flushed, once a second."""
    if not path.exists() or path.stat().st_size == 0:
        return []
    run = read_run(path)
    found = [m.state.value for m in run.messages("insertion", SLAVE_STATE)] if run.axes else []
    return [state for state, _ in groupby(found)]


def test_a_cut_cable_stops_the_slave_and_a_mended_one_brings_everything_back(
    tmp_path: Path, witness_of_daemons: Witness
) -> None:
    with joined_by_veth(tmp_path) as (hosts, cable):
        configure(hosts.folder)
        recording = hosts.folder / "run.mcap"
        slave = hosts.run(0, "slave.log", "forefeel", "slave", "--config", "slave.yaml")
        cell = ["--cell", "cathlab", "--connect", SLAVE_AT, "--connect", MASTER_AT, "--pki", PKI]
        recorder = hosts.run(0, "record.log", "forefeel", "record", "--out", "run.mcap", *cell)
        master = hosts.run(1, "master.log", "forefeel", "master", "--config", "master.yaml")
        hosts.wait_until(lambda: hosts.says("master.log", "session open"))
        hosts.wait_until(lambda: "armed" in states(recording))
        time.sleep(0.5)
        cut_s = cable.cut() / S
        hosts.wait_until(lambda: hosts.says("master.log", "waiting for the slave"))
        hosts.wait_until(lambda: states(recording)[-1] == "idle")
        mended_s = cable.mend() / S
        hosts.wait_until(lambda: states(recording)[-1] == "armed")
        time.sleep(1.0)
        for process in (master, slave, recorder):
            assert hosts.end(process, signal.SIGTERM) == 0
        assert hosts.says("master.log", "session open again")
    run = read_run(recording)
    assert not run.truncated
    check_stops(list(run.messages("insertion", SAFETY_EVENT)))
    check_rest(run, mended_s)
    with witness_of_daemons.timely(WATCHDOG_S):
        check_outage(run, cut_s, mended_s)


def check_rest(run: Run, mended_s: float) -> None:
    """Without a session the stage does not move."""
    events = [(m.stamp_ns / S, m.event) for m in run.messages("insertion", SAFETY_EVENT)]
    lost_s = max(time_s for time_s, event in events if event == "session_lost" and time_s < mended_s)
    stamps_s = run.column("insertion", FORCE, "stamp_ns") / S
    position_m = run.column("insertion", FORCE, "position_m")[(stamps_s > lost_s) & (stamps_s < mended_s)]
    assert np.ptp(position_m) <= 2e-6


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
