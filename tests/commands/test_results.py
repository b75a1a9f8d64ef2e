"""Commands that write: what they leave when they are interrupted or may not write."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import FORCE
from forefeel.files import fresh_folder
from tests.commands.command_line import contents
from tests.simulation.pair import write_csv
from tests.unit.recording_samples import force, put


def test_a_report_is_made_of_a_recording_and_equals_that_of_the_run(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert run(f"loopback --virtual-time --duration 3 --out {out}".split()) == 0
    of_the_run = capsys.readouterr().out.splitlines()
    again = f"report {out}/recording.mcap --out {tmp_path}/new/folder".split()
    assert run(again) == 0
    assert capsys.readouterr().out.splitlines()[:-2] == of_the_run[:-2]  # the folder is another one
    for name in ("report.json", "report.html"):
        assert (tmp_path / "new" / "folder" / name).read_bytes() == (out / name).read_bytes()
    assert run(again) == 2
    assert run([*again, "--overwrite"]) == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("made_before", [False, True])
def test_an_interrupted_run_in_virtual_time_leaves_what_was_recorded(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    number: signal.Signals,
    made_before: bool,
) -> None:
    def show(done_s: float, _what: str) -> None:
        if done_s > 1.0:
            os.kill(os.getpid(), number)

    monkeypatch.setattr("forefeel.loopback.run._shown", lambda *_: show)
    out = tmp_path / "out"
    if made_before:
        out.mkdir()
    assert run(f"loopback --virtual-time --duration 100 --out {out}".split()) == 1
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"forefeel: loopback interrupted; recording.mcap in {out}"
    )
    assert [path.name for path in out.iterdir()] == ["recording.mcap"]
    recorded = read_run(out / "recording.mcap")
    assert not recorded.truncated
    assert recorded.count("insertion", FORCE) > 900


CHILD = """
import os, signal, sys
from importlib import import_module
from forefeel.__main__ import main
where, number, *words = sys.argv[1:]
module, _, name = where.rpartition(".")
real = getattr(import_module(module), name)
signal.signal(int(number), signal.SIG_DFL)
def interrupted(*given):
    os.kill(os.getpid(), int(number))
    return real(*given)
setattr(import_module(module), name, interrupted)
sys.argv = ["forefeel", *words]
main()
"""


def interrupted(where: str, number: signal.Signals, line: str) -> tuple[int, str]:
    """Exit code and last line of a command of its own process, in which `where` is called after a signal."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD, where, str(int(number)), *line.split()],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr.splitlines()[-1]


def put_recordings(folder: Path) -> None:
    time_s = np.arange(0, 10, 0.01)
    write_csv(folder / "run.csv", "time_s,position_m,force_n", [time_s, np.sin(time_s), np.cos(time_s)])
    with RunWriter(folder / "run.mcap") as writer:
        put(writer, force(1))


@pytest.mark.parametrize("made_before", [False, True])
@pytest.mark.parametrize(
    ("line", "where", "what"),
    [
        ("loopback --virtual-time", "forefeel.loopback.run.VirtualLoopback", "loopback"),
        ("evaluate @/run.csv", "forefeel.evaluate.run._evaluate", "evaluation"),
        ("report @/run.mcap", "forefeel.report.run.write_all", "report"),
    ],
)
def test_what_is_interrupted_before_it_wrote_leaves_nothing_that_was_not_there(
    tmp_path: Path, line: str, where: str, what: str, made_before: bool
) -> None:
    put_recordings(tmp_path)
    if made_before:
        (tmp_path / "out").mkdir()
    before = contents(tmp_path)
    words = f"{line} --out @/out".replace("@", str(tmp_path))
    said = f"forefeel: {what} interrupted; nothing was written"
    assert interrupted(where, signal.SIGTERM, words) == (1, said)
    assert contents(tmp_path) == before


def test_a_signal_while_results_are_written_waits_until_they_are_whole(tmp_path: Path) -> None:
    put_recordings(tmp_path)
    words = f"evaluate {tmp_path}/run.csv --out {tmp_path}/out"
    assert interrupted("forefeel.files.write_whole", signal.SIGHUP, words) == (
        1,
        f"forefeel: evaluation interrupted; evaluation.json, evaluation.html in {tmp_path}/out",
    )
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"evaluation.json", "evaluation.html"}


def test_a_folder_that_can_not_be_written_is_refused_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o555)
    monkeypatch.chdir(tmp_path)  # whose parents another user may not pass
    me = os.geteuid()
    if me == 0:
        os.seteuid(65534)
    try:
        with pytest.raises(ConfigurationError) as caught:
            fresh_folder(Path(), ("run.csv",), "an earlier run", overwrite=False)
    finally:
        os.seteuid(me)
        tmp_path.chmod(0o755)
    assert str(caught.value) == "--out .: Permission denied; expected a folder that can be written"
    assert fresh_folder(tmp_path, ("run.csv",), "an earlier run", overwrite=False) == tmp_path
    assert list(tmp_path.iterdir()) == []
