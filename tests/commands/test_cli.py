"""The command line as a person uses it: help, effective settings, a run's results."""

import json
import math
import shlex
import signal
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from forefeel.cli import app
from forefeel.common.config import dump_yaml
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import COMMAND, FORCE
from forefeel.daemon_settings import load_any, load_daemon
from tests.commands.command_line import COMMANDS, ROOT, group
from tests.commands.test_bad_lines import RECORDING, SLAVE


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_help_of_a_command_has_an_example_that_its_options_allow(command: list[str]) -> None:
    shown = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"}, terminal_width=200)
    assert shown.exit_code == 0
    examples = group(command).epilog.split("Example: ")[1:]
    assert examples
    for example in examples:
        assert example.split("--")[0].strip() in shown.output
        words = shlex.split(example)
        assert words[: 1 + len(command)] == ["forefeel", *command]
        group(command).make_context(command[-1], words[1 + len(command) :]).close()


@pytest.mark.parametrize("name", ["slave.yaml", "master.yaml", "recorder.yaml", "router.yaml"])
def test_config_check_prints_settings_that_load_again(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    original = ROOT / "deploy" / "config" / name
    assert run(["config", "check", str(original)]) == 0
    effective = tmp_path / name
    effective.write_text(capsys.readouterr().out)
    assert load_any(effective) == load_any(original)
    assert run(["config", "check", str(effective)]) == 0
    assert capsys.readouterr().out == effective.read_text()
    defaults = yaml.safe_load(effective.read_text())
    assert defaults["transport"]["connections"] is None  # not in the file: a default


def test_config_check_of_a_file_that_names_others_loads_again_from_elsewhere(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf").mkdir()
    (tmp_path / "conf" / "run.csv").write_text(RECORDING)
    cell = "axes: [{load_cell: {driver: recorded, recording: run.csv}}]\n"
    (tmp_path / "conf" / "slave.yaml").write_text(SLAVE + cell)
    assert run(["config", "check", "conf/slave.yaml"]) == 0
    (tmp_path / "conf" / "effective.yaml").write_text(capsys.readouterr().out)
    monkeypatch.chdir("conf")
    assert run(["config", "check", "effective.yaml"]) == 0


def test_the_settings_of_a_plan_load_again_as_they_are(tmp_path: Path) -> None:
    from forefeel.loopback.plan import LoopbackOptions, make_plan

    (tmp_path / "run.csv").write_text(RECORDING)
    plan = make_plan(LoopbackOptions(seed=3, impairment="lte", recording=tmp_path / "run.csv"))
    slave, master = plan.write(tmp_path)
    assert dump_yaml(load_daemon(slave)) == dump_yaml(plan.slave_settings())
    assert dump_yaml(load_daemon(master)) == dump_yaml(plan.master_settings())


def test_a_loopback_run_reports_as_its_recording_does_and_replaces_itself_only_when_asked(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    line = f"loopback --virtual-time --duration 2 --impairment lan --seed 1 --out {out}".split()
    assert run(line) == 0
    said = capsys.readouterr()
    report = said.out
    assert said.err == f"next: forefeel diagnose {out}/recording.mcap --out {out}/diagnosis\n"
    assert len(report.splitlines()) == 10
    assert json.loads((out / "report.json").read_text())["armed_share"] > 0.9
    assert {"recording.mcap", "report.json", "report.html"} <= {path.name for path in out.iterdir()}
    assert run(f"report {out}/recording.mcap --out {tmp_path}/new/folder".split()) == 0
    for name in ("report.json", "report.html"):
        assert (tmp_path / "new" / "folder" / name).read_bytes() == (out / name).read_bytes()
    capsys.readouterr()
    before = (out / "recording.mcap").read_bytes()
    (out / "notes.txt").write_text("mine")
    assert run(line) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert run([*line, "--overwrite"]) == 0
    assert (out / "notes.txt").read_text() == "mine"
    assert len((out / "recording.mcap").read_bytes()) == len(before)
    assert capsys.readouterr().out == report


def test_a_loopback_plays_rows_without_a_time_at_their_rate(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = "".join(f"{0.01 * math.sin(0.05 * n):.6f},{0.1 * math.sin(0.05 * n):.5f}\n" for n in range(200))
    (tmp_path / "run.csv").write_text(f"position_m,force_n\n{rows}")
    line = f"loopback --virtual-time --recording {tmp_path}/run.csv --out {tmp_path}/out".split()
    assert run(line) == 2
    assert "--rate" in capsys.readouterr().err
    assert run([*line, "--rate", "100"]) == 0
    played = Run(tmp_path / "out" / "recording.mcap").column("insertion", COMMAND, "recording_time_s")
    assert np.nanmax(played) == pytest.approx(1.99, abs=2e-3)


def test_a_loopback_that_was_never_armed_fails_with_the_cause(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(f"loopback --virtual-time --duration 0.5 --out {tmp_path}/out".split()) == 1
    said = capsys.readouterr()
    assert len(said.out.splitlines()) == 10
    assert said.err.startswith("forefeel: the slave was never armed: ")
    assert said.err.count("\n") == 1


def test_the_version_is_that_of_the_installed_package(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"forefeel {metadata.version('forefeel')}\n"


@pytest.mark.parametrize("group", [[], ["pki"]])
def test_no_command_prints_the_help(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], group: list[str]
) -> None:
    assert run(group) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert len(shown.out.splitlines()) > 5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_virtual_run_leaves_what_was_recorded(
    run: Callable[[Sequence[str]], int],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    def show(done_s: float, _what: str) -> None:
        if done_s > 1.0:
            signal.raise_signal(number)

    monkeypatch.setattr("forefeel.loopback.run.bar", lambda *_: nullcontext(show))
    out = tmp_path / "out"
    assert run(f"loopback --virtual-time --duration 100 --out {out}".split()) == 1
    assert [path.name for path in out.iterdir()] == ["recording.mcap"]
    recorded = Run(out / "recording.mcap")
    assert not recorded.truncated
    assert recorded.count("insertion", FORCE) > 900
