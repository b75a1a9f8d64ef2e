"""Signals at random times over every command on a busy machine, and a terminal that goes."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from tests.event_lines import read_events
from tests.live_cell import free_port
from tests.system.signals.cases import SLAVE
from tests.system.signals.scene import environment, scene
from tests.system.signals.trial import BOUND_S, run_all, trials, unignored

IN_A_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "forefeel", *sys.argv[1:]])
"""


@pytest.mark.timeout(400)
def test_thirty_signals_end_commands_in_time_and_order(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    ready.mkdir()
    with scene(ready) as port:
        # of the first 40 seeds that whose commands compute least, for other tests run beside them
        found = run_all(trials(30, seed=35), ready, port, tmp_path, nice=10)
    assert len(found) == 30
    assert [f"{trial}: {ended.wrong}" for trial, ended in found if ended.wrong] == []
    # other tests, too, want the processor; `make signals` alone has it for itself
    late = [f"{trial}: {ended}" for trial, ended in found if ended.seconds - ended.waited_s > BOUND_S]
    assert late == []


def test_a_slave_whose_terminal_goes_ends_in_order_and_logs_it(tmp_path: Path) -> None:
    text = SLAVE.replace("PORT", str(free_port())).replace("HERE", str(tmp_path))
    (tmp_path / "slave.yaml").write_text(text)
    ours, its = pty.openpty()
    with unignored():
        process = subprocess.Popen(
            [sys.executable, "-c", IN_A_TERMINAL, "slave", "--config", str(tmp_path / "slave.yaml")],
            stdin=its, stdout=its, stderr=its, start_new_session=True, env=environment(tmp_path),
        )  # fmt: skip
    os.close(its)
    try:
        said = b""
        while b"waiting for a master" not in said:
            said += os.read(ours, 4096)
        os.close(ours)
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()
    last = read_events(tmp_path / "state" / "events.jsonl")[-1]
    assert last.event == "stop" and "stage at rest" in str(last.details)
