"""Signals at random times over every command on a busy machine, and a terminal that goes."""

import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from forefeel.local.audit_text import read_entries, read_verdict
from tests.live_cell import free_port
from tests.signals.cases import SLAVE
from tests.signals.scene import environment, scene
from tests.signals.trial import Trial, run, trials, unignored

IN_A_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "forefeel", *sys.argv[1:]])
"""


@pytest.fixture(scope="module")
def busy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, int]]:
    """What was made before, and the port of a slave; meanwhile both cores compute."""
    folder = tmp_path_factory.mktemp("ready")
    with scene(folder) as port:
        yield folder, port


@pytest.mark.timeout(120)
@pytest.mark.parametrize("trial", trials(30, seed=1), ids=str)
def test_a_signal_ends_a_command_in_time_and_order(
    trial: Trial, busy: tuple[Path, int], tmp_path: Path
) -> None:
    ended = run(trial, *busy, tmp_path / "here")
    assert ended.wrong == ()


def test_a_slave_whose_terminal_goes_ends_in_order_and_says_so_in_its_audit_log(tmp_path: Path) -> None:
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
    verdict = read_verdict(tmp_path / "state" / "audit.jsonl", None)
    assert verdict.intact and verdict.closed
    last = read_entries(tmp_path / "state" / "audit.jsonl")[0][-1]
    assert "stage at rest" in str(last.noted.details)
