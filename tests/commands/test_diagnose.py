"""`forefeel diagnose` as a person uses it."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import Diagnosed, diagnose
from forefeel.results.task import Task, examine
from tests.commands.conftest import Shell
from tests.unit.diagnosis_samples import FRICTION_N, made, one_sine, put
from tests.unit.evaluation_samples import csv_text
from tests.unit.recording_samples import force
from tests.unit.recording_samples import put as put_message

FILES = {"diagnosis.json", "report.html", "model.yaml"}
MODEL = """schema: forefeel.model/1
name: a guess
effects:
  - effect: mass_damper_spring
    parameters: {mass_kg: 0.02, damping_n_s_m: 0.8, stiffness_n_m: 40.0}
"""

_diagnosed: dict[bytes, Diagnosed] = {}


@pytest.fixture(autouse=True)
def each_recording_is_diagnosed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """By what it holds; several at once and those with a given simulation are diagnosed as ever."""

    def diagnosed(recording: Recording, *more: Any) -> Diagnosed:  # noqa: ANN401 - as they come
        if any(more[1:]) or recording.force_n is None:
            return diagnose(recording, *more)
        columns = recording.time_s, recording.position_m, recording.force_n
        key = b"".join(column.tobytes() for column in columns)
        if key not in _diagnosed:
            _diagnosed[key] = diagnose(recording, *more)
        return replace(_diagnosed[key], recording=recording)

    monkeypatch.setattr("forefeel.results.task.diagnose", diagnosed)


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder's recordings are diagnosed in this process."""
    monkeypatch.setattr(
        "forefeel.results.folder.in_parallel", lambda function, tasks, *_: (function(task) for task in tasks)
    )


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def document(folder: Path) -> Any:  # noqa: ANN401 - JSON
    return json.loads((folder / "diagnosis.json").read_text())


def causes(folder: Path) -> list[str]:
    return [cause["name"] for cause in document(folder)["causes"]]


def test_recording_leaves_results_in_folder_named_after_it(shell: Shell) -> None:
    put(shell.folder / "strokes.csv", made(6.0, friction_n=FRICTION_N))
    shell.write({"model.yaml": MODEL})
    out, shown = shell.folder / "strokes", shell("diagnose strokes.csv --model model.yaml")
    assert shown.code == 0
    assert "Cause       coulomb_friction: force " in shown.out
    assert "\x1b" not in shown.out + shown.err
    assert names(out) == FILES
    assert document(out)["prediction_300_ms"] is not None
    assert causes(out) == ["coulomb_friction"]
    assert document(out)["baseline"]["parameters"]["mass_damper_spring.stiffness_n_m"] == 40.0
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert "coulomb_friction" in [entry["effect"] for entry in model["effects"]]
    shell.refused("diagnose strokes.csv", ("earlier diagnosis",))
    assert shell("diagnose strokes.csv --overwrite --no-replay --no-page").code == 0
    assert names(out) == FILES - {"report.html"}
    assert document(out)["prediction_300_ms"] is document(out)["confirmation"] is None


def test_model_is_held_against_another_recording(shell: Shell) -> None:
    put(shell.folder / "monday.csv", made(6.0, friction_n=FRICTION_N))
    put(shell.folder / "tuesday.csv", made(friction_n=FRICTION_N, bias_n=0.2, name="tuesday"))
    shown = shell("diagnose monday.csv --confirm tuesday.csv --no-replay --out out")
    assert shown.code == 0
    assert "\nConfirmed   on tuesday: off by " in shown.out
    confirmation = document(shell.folder / "out")["confirmation"]
    assert confirmation["verdict"] == "confirmed"
    assert confirmation["gain"]["gain_low"] > 0.5
    page = (shell.folder / "out" / "report.html").read_text()
    assert "Force of the other recording, measured and simulated" in page


def test_recordings_answer_together_what_none_answers_alone(shell: Shell) -> None:
    """One stroke at one speed does not tell the mass from the spring; three of them do."""
    for i, stroke in enumerate(((0.5, 6e-3), (1.3, 3e-3), (0.9, 2e-3))):
        put(shell.folder / f"{i}.csv", one_sine(*stroke))
    masses = []
    for files in ("0.csv", "0.csv 1.csv 2.csv --together"):
        shown = shell(f"diagnose {files} --no-page --no-replay --out out --overwrite")
        assert shown.code == 0
        assert causes(shell.folder / "out") == ["coulomb_friction"]
        masses.append(document(shell.folder / "out")["extended"]["intervals"]["mass_kg"])
    assert masses[0]["low"] <= 0.0 < masses[1]["low"] < 0.02 < masses[1]["high"] < 0.025
    assert "gaps" not in document(shell.folder / "out")["flags"]
    assert "7500 samples, 30.0 s" in shown.out


@pytest.mark.usefixtures("one_process")
def test_folder_skips_bad_recordings_and_keeps_earlier_diagnosis(shell: Shell) -> None:
    shell.write({"in/notes.md": "no recording", "in/.hidden.csv": ""})
    folder, out = shell.folder / "in", shell.folder / "out"
    put(folder / "quiet.csv", made(5.0))
    put(folder / "rubs.csv", made(6.0, friction_n=FRICTION_N))
    put(folder / "short.csv", made(1.0))
    (folder / "rubs.parquet").write_bytes(b"another export of the same")
    put(folder / "done.csv", made(5.0))
    (out / "done").mkdir(parents=True)
    (out / "done" / "diagnosis.json").write_text("{}")
    shown = shell("diagnose in --out out")
    assert shown.code == 0
    assert document(out / "done") == {}
    assert names(out) == {"done", "quiet", "rubs", "summary.json"}
    assert names(out / "rubs") == names(out / "quiet") == FILES
    assert "2 of 5 diagnosed, 3 skipped, 0 failed" in shown.out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["schema"] == "forefeel.diagnoses/1"
    found = {stem: entry["causes"] for stem, entry in summary["recordings"].items()}
    assert found == {"quiet": [], "rubs": ["coulomb_friction"]}
    assert set(summary["skipped"]) == {"short.csv", "rubs.parquet", "done.csv"}


@pytest.mark.parametrize("source", ["strokes.csv", "."])
@pytest.mark.usefixtures("one_process")
def test_page_that_fails_leaves_verdict(shell: Shell, monkeypatch: pytest.MonkeyPatch, source: str) -> None:
    results = shell.folder / ("out" if source == "strokes.csv" else "out/strokes")
    put(shell.folder / "strokes.csv", made(6.0, friction_n=FRICTION_N))

    def broken(*_: object) -> str:
        assert source == "." or names(results) == FILES - {"report.html"}
        raise IndexError("list index out of range")

    monkeypatch.setattr("forefeel.results.page.render_page", broken)
    shown = shell(f"diagnose {source} --out out")
    assert shown.code == 0
    assert "strokes.csv: diagnosed, but report.html failed, IndexError" in shown.err
    assert source == "." or "coulomb_friction" in shown.out
    assert names(results) == FILES - {"report.html"}
    assert document(results)["verdict"] == "cause_found"


@pytest.mark.usefixtures("one_process")
def test_diagnosis_that_fails_does_not_stop_others(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    good = csv_text(made(5.0))
    shell.write({"in/a.csv": good, "in/b.csv": good})
    found = examine(Task(shell.folder / "in" / "b.csv"))

    def fails_on_a(task: Task, tell: object) -> object:
        if task.file.stem == "a":
            raise np.linalg.LinAlgError("Singular matrix")
        return found

    monkeypatch.setattr("forefeel.results.task._examine", fails_on_a)
    shown = shell("diagnose in --out out")
    assert shown.code == 1
    assert "a.csv: the diagnosis failed, LinAlgError: Singular matrix" in shown.err
    assert names(shell.folder / "out") == {"b", "summary.json"}


def test_millimetres_are_asked_for_with_command_that_works(shell: Shell) -> None:
    recording, out = made(5.0, friction_n=FRICTION_N), shell.folder / "in mm"
    put(shell.folder / "in mm.csv", replace(recording, position_m=1e3 * recording.position_m))
    asked = shell(["diagnose", "in mm.csv"])
    assert asked.code == 2
    assert "position_m spans 15.3 m" in asked.err
    assert not out.exists()
    command = shlex.split(asked.err.partition("then type: ")[2])
    assert command == ["forefeel", "diagnose", "in mm.csv", "--position", "mm:position_m"]
    assert shell([*command[1:], "--no-page"]).code == 0
    assert document(out)["verdict"] == "cause_found"
    assert shell(["diagnose", "in mm.csv", "--as-is", "--no-page", "--overwrite"]).code == 0


def test_a_command_is_not_printed_where_it_would_be_refused(shell: Shell) -> None:
    whole = made(5.0, friction_n=FRICTION_N)
    for duration_s, refusal in ((1.0, "s long, expected at least 3 s"), (5.0, None)):
        part = whole.cut(whole.time_s < duration_s)
        assert part.force_n is not None
        rows = np.column_stack([part.time_s, 1e3 * part.position_m, part.force_n])
        np.savetxt("plain.csv", rows, "%.9g", ",", header="Time,Displacement,Load", comments="")
        shown = shell("diagnose plain.csv")
        assert shown.code == 2
        assert ("then type" in shown.err) == (refusal is None)
        assert (refusal or "--position mm:Displacement") in shown.err


def test_of_several_axes_one_has_to_be_named(shell: Shell) -> None:
    whole = made(4.0, friction_n=FRICTION_N)
    assert whole.force_n is not None
    with RunWriter(shell.folder / "run.mcap") as writer:
        for k, (x, f) in enumerate(zip(whole.position_m, whole.force_n, strict=True)):
            for axis in ("insertion", "rotation"):
                put_message(writer, force(10 * k, position_m=float(x), force_n=float(f)), axis=axis)
    shell.refused("diagnose run.mcap --out out", ("insertion, rotation",))
    assert shell("diagnose run.mcap --out out --axis insertion").code == 0
    assert document(shell.folder / "out")["verdict"] == "cause_found"


GOOD = csv_text(made(5.0))
SHORT_TOO = {"a.csv": GOOD, "b.csv": csv_text(made(2.0))}
HEADER, *LINES = GOOD.splitlines()
SLOW = "\n".join([HEADER, *LINES[::2]])
BAD = {
    "too short": ("@/a.csv", ("a.csv: 2.89 s long", "at least 3 s"), {"a.csv": csv_text(made(2.9))}),
    "no force": ("@/a.csv", ("a.csv: no force",), {"a.csv": GOOD.replace("force_n", "current_a", 1)}),
    "two files": ("@/a.csv @/b.csv", ("b.csv", "--together"), {"a.csv": GOOD, "b.csv": GOOD}),
    "together alone": ("@/a.csv --together", ("at least two",), {"a.csv": GOOD}),
    "together, other rate": ("@/in --together", ("b.csv", "one rate"), {"in/a.csv": GOOD, "in/b.csv": SLOW}),
    "folder without recordings": ("@/in", ("in: no recording", ".csv"), {"in/a.md": ""}),
    "folder, out is a file": ("@/in", ("out", "is a file"), {"in/a.csv": GOOD, "out": "precious"}),
    "earlier summary": ("@/in", ("earlier diagnosis", "--over"), {"in/a.csv": GOOD, "out/summary.json": "x"}),
    "model broken": ("@/a.csv --model @/m.yaml", ("m.yaml", "schema"), {"a.csv": GOOD, "m.yaml": "a: 1\n"}),
    "scheduler of a file": ("@/a.csv --scheduler x:1", ("--scheduler", "a folder"), {"a.csv": GOOD}),
    "scheduler malformed": ("@/in --scheduler here", ("--scheduler 'here'", "tcp://"), {"in/a.csv": GOOD}),
    "scheduler silent": ("@/in --scheduler 127.0.0.1:1", ("127.0.0.1:1", "refused"), {"in/a.csv": GOOD}),
    "confirmed by a short one": ("@/a.csv --confirm @/b.csv", ("b.csv: 1.99 s long",), SHORT_TOO),
    "confirmed by none": ("@/a.csv --confirm @/b.csv", ("b.csv",), {"a.csv": GOOD}),
    "a folder confirmed": ("@/in --confirm @/in/a.csv", ("--confirm", "is a folder"), {"in/a.csv": GOOD}),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "words", "files"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line_and_what_can_not_confirm_is_refused_before_the_diagnosis(
    shell: Shell,
    monkeypatch: pytest.MonkeyPatch,
    arguments: str,
    words: tuple[str, ...],
    files: dict[str, str],
) -> None:
    if "--confirm" in arguments:
        monkeypatch.setattr("forefeel.results.task.diagnose", None)
    shell.refused(f"diagnose {arguments} --out @/out", words, files)
