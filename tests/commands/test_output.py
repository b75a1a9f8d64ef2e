"""`--json` and `--quiet` of every command that answers: one document, or not a word."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from forefeel.doctor.checks import Finding
from forefeel.loopback.plan import LoopbackOptions, make_plan
from tests.commands.command_line import COMMANDS, group
from tests.commands.conftest import Shell
from tests.looped import looped
from tests.secured import make_pki
from tests.unit.diagnosis_samples import FRICTION_N, made, put

ANSWERS = {
    "config check @/slave.yaml": None,
    "devices": None,
    "device probe --config @/slave.yaml --seconds 0.05": None,
    "doctor": None,
    "pki show @/pki": None,
    "evaluate @/recordings/strokes.csv --out @/out": "evaluation.json",
    "diagnose @/recordings/strokes.csv --out @/out": "diagnosis.json",
    "investigate @/recordings/strokes.csv --seconds 10 --out @/out": "question.json",
    "report @/run.mcap --out @/out": "report.json",
    "resimulate @/run.mcap": None,
    "loopback --virtual-time --duration 3 --seed 1 --out @/out": "report.json",
}
"""A command line -> the file of the document that it answers with `--json`, where it writes one."""
WITH_DEVICES = {"calibrate load-cell", "calibrate stage"}
"""See tests/devices and tests/process: they need a device."""
LASTING = {
    "demo", "home", "slave", "master", "router", "record", "metrics", "ros", "dashboard", "view", "simulate",
}  # fmt: skip
"""Without an answer: `--quiet` alone."""


@pytest.fixture(scope="module")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with something of everything that the commands read."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "slave.yaml").write_text("role: slave\n")
    make_pki(folder / "pki")
    (folder / "recordings").mkdir()
    put(folder / "recordings" / "strokes.csv", made(6.0, friction_n=FRICTION_N))
    looped(make_plan(LoopbackOptions(seed=1, duration_s=3.0))).write(folder / "run.mcap")
    return folder


def options(command: Sequence[str]) -> set[str]:
    return {name for each in group(command).params for name in each.opts}


def test_every_command_that_answers_is_tested_and_has_both_options() -> None:
    named = {" ".join(command): options(command) for command in COMMANDS}
    tested = {name for name in named for line in ANSWERS if line.startswith(f"{name} ") or line == name}
    both = {name for name, found in named.items() if {"--json", "--quiet"} <= found}
    assert both == tested | WITH_DEVICES
    assert {name for name, found in named.items() if "--quiet" in found} - both == LASTING
    assert {name for name, found in named.items() if "--json" in found} <= both


@pytest.mark.parametrize("line", ANSWERS)
def test_json_is_one_document_and_stdout_holds_nothing_else(
    shell: Shell, made_once: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    for each in made_once.iterdir():
        (shell.folder / each.name).symlink_to(each)
    found = [Finding("settings", "slave.yaml", "amber", "loads", "wait")]
    monkeypatch.setattr("forefeel.doctor.checks.examine", lambda *_: found)  # the true one takes long
    code, out, err = shell(f"{line} --json --quiet")
    document, name = json.loads(out), ANSWERS[line]
    assert document
    assert (code, err) == (0, "")
    if name is not None:
        assert document == json.loads((shell.folder / "out" / name).read_text())
        assert document["schema"].startswith("forefeel.")
