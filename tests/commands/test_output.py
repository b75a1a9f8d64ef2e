"""`--json` and `--quiet` of every command that answers: one document, or not a word."""

import json
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from forefeel.doctor.examine import Finding
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from tests.commands.command_line import COMMANDS, ROOT, group
from tests.secured import make_pki
from tests.unit.diagnosis_samples import FRICTION_N, made, put

Run = Callable[[Sequence[str]], int]

ANSWERS = {
    "config check @/slave.yaml": None,
    "devices": None,
    "device probe --config @/slave.yaml --seconds 0.05": None,
    "doctor": None,
    "pki show @/pki": None,
    "evaluate @/recordings/strokes.csv --out @/out": "evaluation.json",
    "diagnose @/recordings/strokes.csv --out @/out": "diagnosis.json",
    "diagnose @/recordings --out @/out": "summary.json",
    "report @/run.mcap --out @/out": "report.json",
    "loopback --virtual-time --duration 3 --seed 1 --out @/out": "report.json",
}
"""A command line -> the file of the document that it answers with `--json`, where it writes one."""
QUICK = [line for line, file in ANSWERS.items() if file in {None, "evaluation.json"}]
WITH_DEVICES = {"calibrate load-cell", "calibrate stage"}
"""See tests/devices and tests/process: they need a device."""
LASTING = {"slave", "master", "router", "record", "metrics", "dashboard", "view", "simulate"}
"""Without an answer: `--quiet` alone."""


@pytest.fixture(scope="module")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with something of everything that the commands read."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "slave.yaml").write_text("role: slave\n")
    make_pki(folder / "pki")
    (folder / "recordings").mkdir()
    put(folder / "recordings" / "strokes.csv", made(6.0, friction_n=FRICTION_N))
    loop = VirtualLoopback(make_plan(LoopbackOptions(seed=1, duration_s=3.0)), 1)
    loop.run(lambda _: None)
    loop.write(folder / "run.mcap")
    return folder


@pytest.fixture
def words(made_once: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[str]]:
    """The words of a command line, with files that exist; what takes long is short."""
    for each in made_once.iterdir():
        (tmp_path / each.name).symlink_to(each)
    found = [Finding("settings", "slave.yaml", "amber", "loads", "wait")]
    monkeypatch.setattr("forefeel.doctor.examine.examine", lambda *_: found)
    return lambda line: line.replace("@", str(tmp_path)).split()


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
    run: Run, words: Callable[[str], list[str]], capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str
) -> None:
    assert run([*words(line), "--json", "--quiet"]) == 0
    shown = capsys.readouterr()
    document = json.loads(shown.out)
    assert document
    assert shown.err == ""
    name = ANSWERS[line]
    if name is not None:
        assert document == json.loads((tmp_path / "out" / name).read_text())
        assert document["schema"].startswith("forefeel.")


@pytest.mark.parametrize("line", QUICK)
def test_quiet_says_nothing_and_writes_its_files(
    run: Run, words: Callable[[str], list[str]], capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str
) -> None:
    assert run([*words(line), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    name = ANSWERS[line]
    assert name is None or (tmp_path / "out" / name).exists()


@pytest.mark.parametrize("line", QUICK)
def test_without_them_there_is_an_answer_in_plain_text(
    run: Run,
    words: Callable[[str], list[str]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    line: str,
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich would take it for a terminal
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    assert run(words(line)) == 0
    shown = capsys.readouterr()
    assert shown.out
    assert "\x1b" not in shown.out + shown.err
    with pytest.raises(json.JSONDecodeError):
        json.loads(shown.out)


FAILING = {
    "config check @/none.yaml": 2,
    "device probe --config @/none.yaml": 2,
    "doctor --config @/none.yaml": 2,
    "pki show @/none": 2,
    "evaluate @/none.csv --out @/out": 2,
    "diagnose @/none.csv --out @/out": 2,
    "report @/none.mcap --out @/out": 2,
    "loopback --virtual-time --impairment mars --out @/out": 2,
    "calibrate load-cell --config @/none.yaml --axis a --forces 1 --out @/c.yaml": 2,
    "calibrate stage --config @/none.yaml --axis a --out @/c.yaml": 2,
    "view @/none.mcap": 2,
    "dashboard --config @/none.yaml": 2,
    "slave --config @/none.yaml": 2,
    "master --config @/none.yaml": 2,
    "record --out @/r.mcap --connect nowhere": 2,
    "router --config @/none.yaml": 2,
    "metrics --config @/none.yaml": 2,
    "simulate --model @/none.yaml --out @/run.csv": 2,
}


@pytest.mark.parametrize("line", FAILING)
def test_quiet_says_what_is_wrong_in_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str
) -> None:
    assert run([*line.replace("@", str(tmp_path)).split(), "--quiet"]) == FAILING[line]
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("forefeel: ")
    assert shown.err.count("\n") == 1


def test_a_simulation_can_be_quiet(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    model = "schema: forefeel.model/1\nname: x\neffects:\n  - effect: mass_damper_spring\n"
    (tmp_path / "model.yaml").write_text(model)
    simulate = f"simulate --model {tmp_path}/model.yaml --duration 0.2 --out {tmp_path}/run.csv".split()
    assert run([*simulate, "--quiet"]) == 0
    assert (tmp_path / "run.csv").exists()
    assert capsys.readouterr() == ("", "")
    assert run([*simulate, "--overwrite"]) == 0
    assert "201 samples" in capsys.readouterr().out


@pytest.mark.parametrize("quiet", [False, True])
@pytest.mark.parametrize("line", ["slave --config @/file.yaml", "router --cell a --listen ENDPOINT"])
def test_a_daemon_can_be_quiet(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str, quiet: bool
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    (tmp_path / "file.yaml").write_text(f"role: slave\ntransport: {{listen: ['{endpoint}']}}\n")
    words = line.replace("@", str(tmp_path)).replace("ENDPOINT", endpoint).split()
    assert run([*words, "--duration", "0.2", *(["--quiet"] if quiet else [])]) == 0
    shown = capsys.readouterr()
    assert shown.out == ""
    assert (shown.err == "") == quiet


def test_settings_as_json_are_those_of_the_file(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import yaml

    file = str(ROOT / "deploy" / "config" / "router.yaml")
    assert run(["config", "check", file]) == 0
    effective: Any = yaml.safe_load(capsys.readouterr().out)
    assert run(["config", "check", file, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == effective
