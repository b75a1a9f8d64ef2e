"""The command line as a person uses it: help, effective settings, a run's results."""

import json
import math
import os
import shlex
import signal
import sys
from contextlib import nullcontext
from importlib import metadata

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from forefeel.__main__ import run
from forefeel.cli import app
from forefeel.common.config import dump_yaml
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import COMMAND, FORCE
from forefeel.daemon_settings import load_any, load_daemon
from forefeel.loopback.plan import LoopbackOptions, make_plan
from tests.commands.command_line import COMMANDS, ROOT, group
from tests.commands.conftest import Shell
from tests.commands.test_bad_lines import RECORDING

LOOPBACK = "loopback --virtual-time --out out"


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
def test_config_check_prints_settings_that_load_again(shell: Shell, name: str) -> None:
    original, effective = ROOT / "deploy" / "config" / name, shell.folder / name
    effective.write_text(shell(f"config check {original}").out)
    assert load_any(effective) == load_any(original)
    assert shell(f"config check {name}").out == effective.read_text()
    defaults = yaml.safe_load(effective.read_text())
    assert defaults["transport"]["connections"] is None  # not in the file: a default


def test_the_settings_of_a_plan_load_again_as_they_are(shell: Shell) -> None:
    shell.write({"run.csv": RECORDING})
    plan = make_plan(LoopbackOptions(seed=3, impairment="lte", recording=shell.folder / "run.csv"))
    slave, master = plan.write(shell.folder)
    assert dump_yaml(load_daemon(slave)) == dump_yaml(plan.slave_settings())
    assert dump_yaml(load_daemon(master)) == dump_yaml(plan.master_settings())


def test_a_loopback_run_reports_as_its_recording_does_and_replaces_itself_only_when_asked(
    shell: Shell,
) -> None:
    out, line = shell.folder / "out", f"{LOOPBACK} --duration 2 --impairment lan --seed 1"
    first = shell(line)
    assert (first.code, len(first.out.splitlines())) == (0, 10)
    assert first.err == "next: forefeel diagnose out/recording.mcap --out out/diagnosis\n"
    assert json.loads((out / "report.json").read_text())["armed_share"] > 0.9
    assert {"recording.mcap", "report.json", "report.html"} <= {path.name for path in out.iterdir()}
    report = shell("report out/recording.mcap --out new/folder")
    assert (report.code, report.err) == (0, ""), "too short a run for a diagnosis"
    for name in ("report.json", "report.html"):
        assert (shell.folder / "new" / "folder" / name).read_bytes() == (out / name).read_bytes()
    before = (out / "recording.mcap").stat().st_size
    shell.refused(line, ("--overwrite",), {"out/notes.txt": "mine"})
    again = shell(f"{line} --overwrite")
    assert (again.code, again.out) == (0, first.out)
    assert (out / "notes.txt").read_text() == "mine"
    assert (out / "recording.mcap").stat().st_size == before


def test_a_loopback_plays_rows_without_a_time_at_their_rate(shell: Shell) -> None:
    rows = "".join(f"{0.01 * math.sin(0.05 * n):.6f},{0.1 * math.sin(0.05 * n):.5f}\n" for n in range(200))
    line = f"{LOOPBACK} --recording run.csv"
    shell.refused(line, ("--rate",), {"run.csv": f"position_m,force_n\n{rows}"})
    assert shell(f"{line} --rate 100").code == 0
    played = Run(shell.folder / "out" / "recording.mcap").column("insertion", COMMAND, "recording_time_s")
    assert np.nanmax(played) == pytest.approx(1.99, abs=2e-3)


def test_a_loopback_that_was_never_armed_fails_with_the_cause(shell: Shell) -> None:
    shown = shell(f"{LOOPBACK} --duration 0.5")
    assert (shown.code, len(shown.out.splitlines())) == (1, 10)
    assert shown.err.startswith("forefeel: the slave was never armed: ")
    assert shown.err.count("\n") == 1


def test_the_version_is_that_of_the_installed_package(shell: Shell) -> None:
    assert shell("--version") == (0, f"forefeel {metadata.version('forefeel')}\n", "")


@pytest.mark.parametrize("group", ["", "pki"])
def test_no_command_prints_the_help(shell: Shell, group: str) -> None:
    shown = shell(group)
    assert (shown.code, shown.err) == (0, "")
    assert len(shown.out.splitlines()) > 5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_virtual_run_leaves_what_was_recorded(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def show(done_s: float, _what: str) -> None:
        if done_s > 1.0:
            signal.raise_signal(number)

    monkeypatch.setattr("forefeel.loopback.run.bar", lambda *_: nullcontext(show))
    assert shell(f"{LOOPBACK} --duration 100").code == 1
    (path,) = (shell.folder / "out").iterdir()
    recorded = Run(path)
    assert not recorded.truncated
    assert recorded.count("insertion", FORCE) > 900


@pytest.mark.parametrize("name", ["stdin", "stdout", "stderr"])
def test_a_closed_stream_is_open_on_nothing(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(sys, name, None)
    monkeypatch.setattr("forefeel.__main__.main", lambda: None)
    run()
    with getattr(sys, name) as stream:
        assert stream.name == os.devnull
