"""`forefeel diagnose` as a person uses it."""

import json
import shlex
import sys
from collections.abc import Callable, Sequence
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
from tests.commands.command_line import contents, refused
from tests.unit.diagnosis_samples import FRICTION_N, made, one_sine, put
from tests.unit.evaluation_samples import csv_text
from tests.unit.recording_samples import force
from tests.unit.recording_samples import put as put_message

Run = Callable[[Sequence[str]], int]
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


def document(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "diagnosis.json").read_text())
    return found


def test_recording_leaves_results_in_folder_named_after_it(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    put(tmp_path / "strokes.csv", made(6.0, friction_n=FRICTION_N))
    (tmp_path / "model.yaml").write_text(MODEL)
    assert run(["diagnose", "strokes.csv", "--model", "model.yaml"]) == 0
    shown, out = capsys.readouterr(), tmp_path / "strokes"
    assert "Cause       coulomb_friction: force " in shown.out
    assert "\x1b" not in shown.out + shown.err
    assert names(out) == FILES
    found = document(out)
    assert found["prediction_300_ms"] is not None
    assert [cause["name"] for cause in found["causes"]] == ["coulomb_friction"]  # type: ignore[attr-defined]
    assert found["baseline"]["parameters"]["mass_damper_spring.stiffness_n_m"] == 40.0  # type: ignore[index]
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert "coulomb_friction" in [entry["effect"] for entry in model["effects"]]
    before = contents(out)
    assert run(["diagnose", "strokes.csv"]) == 2
    assert "earlier diagnosis" in capsys.readouterr().err
    assert contents(out) == before
    assert run(["diagnose", "strokes.csv", "--overwrite", "--no-replay", "--no-page"]) == 0
    assert names(out) == FILES - {"report.html"}
    assert document(out)["prediction_300_ms"] is document(out)["confirmation"] is None


def test_model_is_held_against_another_recording(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    first = put(tmp_path / "monday.csv", made(6.0, friction_n=FRICTION_N))
    other = made(friction_n=FRICTION_N, bias_n=0.2, name="tuesday")
    second = put(tmp_path / "tuesday.csv", other)
    out = tmp_path / "out"
    words = ["diagnose", str(first), "--confirm", str(second), "--no-replay", "--out", str(out)]
    assert run(words) == 0
    assert "\nConfirmed   on tuesday: off by " in capsys.readouterr().out
    confirmation = document(out)["confirmation"]
    assert confirmation["verdict"] == "confirmed"  # type: ignore[index]
    assert confirmation["gain"]["gain_low"] > 0.5  # type: ignore[index]
    assert "Force of the other recording, measured and simulated" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (["a.csv", "--confirm", "short.csv"], "short.csv: 1.99 s long, expected at least 3 s"),
        (["a.csv", "--confirm", "missing.csv"], "missing.csv"),
        ([".", "--confirm", "a.csv"], "--confirm: . is a folder"),
    ],
)
def test_what_can_not_confirm_is_refused_before_the_diagnosis(
    run: Run,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    files: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("forefeel.results.task.diagnose", None)
    put(tmp_path / "a.csv", made())
    put(tmp_path / "short.csv", made(2.0))
    assert run(["diagnose", *files, "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_recordings_answer_together_what_none_answers_alone(run: Run, tmp_path: Path) -> None:
    """One stroke at one speed does not tell the mass from the spring; three of them do."""
    strokes = (0.5, 6e-3), (1.3, 3e-3), (0.9, 2e-3)
    files = [put(tmp_path / f"{i}.csv", one_sine(*stroke)) for i, stroke in enumerate(strokes)]
    for place, sources in (("alone", files[:1]), ("all", [*files, "--together"])):
        words = [*map(str, sources), "--no-page", "--no-replay", "--out", str(tmp_path / place)]
        assert run(["diagnose", *words]) == 0
    alone, together = document(tmp_path / "alone"), document(tmp_path / "all")
    for found in (alone, together):
        assert [cause["name"] for cause in found["causes"]] == ["coulomb_friction"]  # type: ignore[attr-defined]
    masses = [found["extended"]["intervals"]["mass_kg"] for found in (alone, together)]  # type: ignore[index]
    assert masses[0]["low"] <= 0.0 < masses[1]["low"] < 0.02 < masses[1]["high"] < 0.025
    assert "gaps" not in together["flags"]  # type: ignore[operator]


@pytest.mark.usefixtures("one_process")
def test_folder_skips_bad_recordings_and_keeps_earlier_diagnosis(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    put(folder / "quiet.csv", made(5.0))
    put(folder / "rubs.csv", made(6.0, friction_n=FRICTION_N))
    put(folder / "short.csv", made(1.0))
    (folder / "rubs.parquet").write_bytes(b"another export of the same")
    (folder / "notes.md").write_text("no recording")
    (folder / ".hidden.csv").write_text("")
    put(folder / "done.csv", made(5.0))
    (out / "done").mkdir(parents=True)
    (out / "done" / "diagnosis.json").write_text("{}")
    assert run(["diagnose", str(folder), "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert (out / "done" / "diagnosis.json").read_text() == "{}"
    assert names(out) == {"done", "quiet", "rubs", "summary.json"}
    assert names(out / "rubs") == names(out / "quiet") == FILES
    assert "2 of 5 diagnosed, 3 skipped, 0 failed" in shown.out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["schema"] == "forefeel.diagnoses/1"
    assert {stem: entry["causes"] for stem, entry in summary["recordings"].items()} == {
        "quiet": [],
        "rubs": ["coulomb_friction"],
    }
    assert set(summary["skipped"]) == {"short.csv", "rubs.parquet", "done.csv"}


@pytest.mark.parametrize("source", ["strokes.csv", "."])
@pytest.mark.usefixtures("one_process")
def test_page_that_fails_leaves_verdict(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str
) -> None:
    out = tmp_path / "out"
    results = out if source == "strokes.csv" else out / "strokes"
    put(tmp_path / "strokes.csv", made(6.0, friction_n=FRICTION_N))

    def broken(*_: object) -> str:
        if source == "strokes.csv":
            assert names(results) == FILES - {"report.html"}
            assert "coulomb_friction" in capsys.readouterr().out
        raise IndexError("list index out of range")

    monkeypatch.setattr("forefeel.results.page.render_page", broken)
    assert run(["diagnose", str(tmp_path / source), "--out", str(out)]) == 0
    assert "strokes.csv: diagnosed, but report.html failed, IndexError" in capsys.readouterr().err
    assert names(results) == FILES - {"report.html"}
    assert document(results)["verdict"] == "cause_found"


@pytest.mark.usefixtures("one_process")
def test_diagnosis_that_fails_does_not_stop_others(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for name in ("a", "b"):
        put(folder / f"{name}.csv", made(5.0))
    found = examine(Task(folder / "b.csv"))

    def fails_on_a(task: Task, tell: object) -> object:
        if task.file.stem == "a":
            raise np.linalg.LinAlgError("Singular matrix")
        return found

    monkeypatch.setattr("forefeel.results.task._examine", fails_on_a)
    assert run(["diagnose", str(folder), "--out", str(out)]) == 1
    assert "a.csv: the diagnosis failed, LinAlgError: Singular matrix" in capsys.readouterr().err
    assert names(out) == {"b", "summary.json"}


def test_millimetres_are_asked_for_with_command_that_works(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    recording = made(5.0, friction_n=FRICTION_N)
    put(tmp_path / "in mm.csv", replace(recording, position_m=1e3 * recording.position_m))
    assert run(["diagnose", "in mm.csv"]) == 2
    asked = capsys.readouterr().err
    assert "position_m spans 15.3 m" in asked
    assert not (tmp_path / "in mm").exists()
    command = shlex.split(asked.partition("then type: ")[2])
    assert command == ["forefeel", "diagnose", "in mm.csv", "--position", "mm:position_m"]
    assert run([*command[1:], "--no-page"]) == 0
    assert document(tmp_path / "in mm")["verdict"] == "cause_found"
    assert run(["diagnose", "in mm.csv", "--as-is", "--no-page", "--overwrite"]) == 0


def test_a_command_is_not_printed_where_it_would_be_refused(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    whole = made(5.0, friction_n=FRICTION_N)
    for duration_s, refusal in ((1.0, "s long, expected at least 3 s"), (5.0, None)):
        part = whole.cut(whole.time_s < duration_s)
        assert part.force_n is not None
        rows = np.column_stack([part.time_s, 1e3 * part.position_m, part.force_n])
        np.savetxt(tmp_path / "plain.csv", rows, "%.9g", ",", header="Time,Displacement,Load", comments="")
        assert run(["diagnose", str(tmp_path / "plain.csv")]) == 2
        asked = capsys.readouterr().err
        assert ("then type" in asked) == (refusal is None)
        assert (refusal or "--position mm:Displacement") in asked


def test_of_several_axes_one_has_to_be_named(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    whole = made(4.0, friction_n=FRICTION_N)
    assert whole.force_n is not None
    with RunWriter(tmp_path / "run.mcap") as writer:
        for k, (x, f) in enumerate(zip(whole.position_m, whole.force_n, strict=True)):
            for axis in ("insertion", "rotation"):
                put_message(writer, force(10 * k, position_m=float(x), force_n=float(f)), axis=axis)
    words = ["diagnose", str(tmp_path / "run.mcap"), "--out", str(tmp_path / "out")]
    assert run(words) == 2
    assert "insertion, rotation" in capsys.readouterr().err
    assert run([*words, "--axis", "insertion"]) == 0
    assert document(tmp_path / "out")["verdict"] == "cause_found"


GOOD = csv_text(made(5.0))
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
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "words", "files"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line(
    run: Run,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: str,
    words: tuple[str, ...],
    files: dict[str, str],
) -> None:
    refused(run, capsys, tmp_path, f"diagnose {arguments} --out @/out", words, files)


def test_cluster_without_its_extra_is_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    line = "diagnose @/in --scheduler tcp://127.0.0.1:8786 --out @/out"
    refused(run, capsys, tmp_path, line, ("forefeel[cluster]",), {"in/a.csv": GOOD})
