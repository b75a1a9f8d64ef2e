"""`forefeel diagnose` as a person uses it."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml

from forefeel.__main__ import main
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.diagnose.examine import Task, examine
from forefeel.diagnose.parallel import attempt
from tests.commands.command_line import contents
from tests.unit.diagnosis_samples import FRICTION_N, made, motion, one_sine, put
from tests.unit.evaluation_samples import Floats, csv_text, recording
from tests.unit.recording_samples import force, write_forces
from tests.unit.recording_samples import put as put_message

Run = Callable[[Sequence[str]], int]
FILES = {"diagnosis.json", "report.html", "model.yaml"}
HEADER = "time_s,position_m,force_n\n"
MODEL = """schema: forefeel.model/1
name: a guess
effects:
  - effect: mass_damper_spring
    parameters: {mass_kg: 0.02, damping_n_s_m: 0.8, stiffness_n_m: 40.0}
"""


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the command line in this process as the installed script does; its exit code."""

    def run(arguments: Sequence[str]) -> int:
        monkeypatch.setattr(sys, "argv", ["forefeel", "diagnose", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code if isinstance(ended.value.code, int) else 0

    return run


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_recording_leaves_numbers_page_and_model_and_a_short_answer(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file, out = put(tmp_path / "strokes.csv", made(6.0, friction_n=FRICTION_N)), tmp_path / "new" / "out"
    (tmp_path / "model.yaml").write_text(MODEL)
    assert run([str(file), "--model", str(tmp_path / "model.yaml"), "--out", str(out)]) == 0
    assert names(out) == FILES
    document = json.loads((out / "diagnosis.json").read_text())
    assert [cause["name"] for cause in document["causes"]] == ["coulomb_friction"]
    assert document["baseline"]["parameters"]["mass_damper_spring.stiffness_n_m"] == 40.0
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert "coulomb_friction" in [entry["effect"] for entry in model["effects"]]
    assert "the given model" in (out / "report.html").read_text()
    shown = capsys.readouterr()
    assert "Cause       coulomb_friction: force " in shown.out
    assert shown.out.count("\n") < 16
    assert "searching for causes" in shown.err
    assert "\x1b" not in shown.out + shown.err
    text = (out / "diagnosis.json").read_text()
    assert run([str(file), "--out", str(out)]) == 2
    assert "earlier diagnosis" in capsys.readouterr().err
    assert (out / "diagnosis.json").read_text() == text


def test_replay_and_page_are_left_out_when_asked(run: Run, tmp_path: Path) -> None:
    file, out = put(tmp_path / "strokes.csv", made(6.0, friction_n=FRICTION_N)), tmp_path / "out"
    assert run([str(file), "--out", str(out)]) == 0
    assert json.loads((out / "diagnosis.json").read_text())["prediction_300_ms"] is not None
    assert run([str(file), "--out", str(out), "--overwrite", "--no-replay", "--no-page"]) == 0
    assert names(out) == FILES - {"report.html"}  # nor does the page of the diagnosis before stay
    assert json.loads((out / "diagnosis.json").read_text())["prediction_300_ms"] is None


def test_recordings_of_one_bench_answer_together_what_none_answers_alone(run: Run, tmp_path: Path) -> None:
    """One stroke and speed tells friction from nothing else; three of them do."""
    strokes = (0.5, 6e-3), (1.3, 3e-3), (0.9, 2e-3)
    files = [put(tmp_path / f"{i}.csv", one_sine(*stroke)) for i, stroke in enumerate(strokes)]
    for place, sources in (("alone", files[:1]), ("all", [*files, "--together"])):
        assert run([*map(str, sources), "--no-page", "--no-replay", "--out", str(tmp_path / place)]) == 0
    alone, together = (json.loads((tmp_path / p / "diagnosis.json").read_text()) for p in ("alone", "all"))
    assert (alone["verdict"], together["verdict"]) == ("not_separable", "cause_found")
    assert [cause["name"] for cause in together["causes"]] == ["coulomb_friction"]
    assert "gaps" not in together["flags"]


def test_columns_are_named_with_their_units(run: Run, tmp_path: Path) -> None:
    whole = made(5.0)
    assert whole.force_n is not None
    table = np.column_stack([1e3 * whole.time_s, 1e3 * whole.position_m, 1e3 * whole.force_n])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,laser,load", comments="")
    words = ["--time", "ms:t", "--position", "mm:laser", "--force", "mN:load"]
    assert run([str(tmp_path / "a.csv"), *words, "--out", str(tmp_path / "out")]) == 0
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["baseline"]["parameters"]["stiffness_n_m"] == pytest.approx(40.0, rel=0.02)


def test_a_folder_is_done_past_bad_recordings_and_an_earlier_diagnosis_is_kept(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    put(folder / "quiet.csv", made(5.0))
    put(folder / "rubs.csv", made(6.0, friction_n=FRICTION_N))
    put(folder / "short.csv", made(1.0))
    (folder / "rubs.parquet").write_bytes(b"another export of the same")
    (folder / "notes.txt").write_text("no recording")
    (folder / ".hidden.csv").write_text("")
    put(folder / "done.csv", made(5.0))
    (out / "done").mkdir(parents=True)
    (out / "done" / "diagnosis.json").write_text("{}")
    assert run([str(folder), "--jobs", "2", "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert (out / "done" / "diagnosis.json").read_text() == "{}"
    assert names(out) == {"done", "quiet", "rubs", "summary.json"}
    assert names(out / "rubs") == names(out / "quiet") == FILES
    assert [line.split(":")[0] for line in shown.err.splitlines() if "short" in line] == ["skipped"]
    assert "rubs.csv has the same stem" in shown.err
    assert "2 of 5 diagnosed, 3 skipped, 0 failed" in shown.out
    rows = {line.split("|")[1].strip(): line for line in shown.out.splitlines() if line.startswith("| ")}
    assert "cause_found: coulomb_friction" in rows["rubs"]
    assert "nothing_missing" in rows["quiet"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["schema"] == "forefeel.diagnoses/1"
    assert {stem: entry["causes"] for stem, entry in summary["recordings"].items()} == {
        "quiet": [],
        "rubs": ["coulomb_friction"],
    }
    assert set(summary["skipped"]) == {"short.csv", "rubs.parquet", "done.csv"}


def test_a_diagnosis_that_breaks_is_said_and_the_others_go_on(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for name in ("a", "b"):
        put(folder / f"{name}.csv", made(5.0))
    found = examine(Task(folder / "b.csv"))

    def breaks_on_a(task: Task) -> object:
        if task.file.stem == "a":
            raise np.linalg.LinAlgError("Singular matrix")
        return found

    monkeypatch.setattr("forefeel.diagnose.examine._examined", lambda task, tell: breaks_on_a(task))
    here = "forefeel.diagnose.folder.outcomes"  # not in other processes, which know nothing of the patch
    monkeypatch.setattr(here, lambda tasks, *_: (attempt(each) for each in tasks))
    assert run([str(folder), "--out", str(out)]) == 1
    shown = capsys.readouterr().err
    assert "a.csv: the diagnosis failed, LinAlgError: Singular matrix" in shown
    assert names(out) == {"b", "summary.json"}


def moved(change: Callable[[Floats, Floats, Floats], None]) -> str:
    """A good recording of 4 s as CSV, changed."""
    t, x = motion(4.0)
    columns = t.copy(), x.copy(), 40.0 * x + np.random.default_rng(1).normal(0.0, 2e-3, len(t))
    change(*columns)
    return HEADER + "".join(
        f"{a!r},{b!r},{c!r}\n" for a, b, c in zip(*(column.tolist() for column in columns), strict=True)
    )


def stands(t: Floats, x: Floats, f: Floats) -> None:
    x[:] = 0.01


def flat(t: Floats, x: Floats, f: Floats) -> None:
    f[:] = 0.3


def back(t: Floats, x: Floats, f: Floats) -> None:
    t[200] = t[198]


def nan(t: Floats, x: Floats, f: Floats) -> None:
    f[100] = np.nan


def torn(t: Floats, x: Floats, f: Floats) -> None:
    t += np.floor(np.arange(len(t)) / 4)


GOOD = csv_text(made(5.0))
SLOW = HEADER + "".join(f"{line}\n" for line in GOOD.splitlines()[1::2])  # half of the rate
BAD = {
    "too short": ("@/a.csv", ("a.csv: 2.89 s long", "at least 3 s"), {"a.csv": csv_text(made(2.9))}),
    "two samples": ("@/a.csv", ("a.csv",), {"a.csv": HEADER + "0,0,0\n9,1,1\n"}),
    "no motion": ("@/a.csv", ("a.csv", "position never changes"), {"a.csv": moved(stands)}),
    "flat force": ("@/a.csv", ("a.csv", "force never changes"), {"a.csv": moved(flat)}),
    "time back": ("@/a.csv", ("a.csv: line 202", "'time_s'", "time to increase"), {"a.csv": moved(back)}),
    "nan": ("@/a.csv", ("a.csv: line 102", "'force_n'", "finite"), {"a.csv": moved(nan)}),
    "gaps only": ("@/a.csv", ("a.csv", "no stretch without gaps"), {"a.csv": moved(torn)}),
    "no number": ("@/a.csv", ("a.csv: line 3", "'much'", "number"), {"a.csv": HEADER + "0,0,0\n1,1,much\n"}),
    "unknown unit": ("@/a.csv --force V:force_n", ("'V:force_n'", "unknown unit 'V'"), {"a.csv": GOOD}),
    "no unit": ("@/a.csv --force force_n", ("force = 'force_n'", "unit:column"), {"a.csv": GOOD}),
    "missing column": ("@/a.csv --force N:load", ("a.csv: no column 'load'", "'force_n'"), {"a.csv": GOOD}),
    "no force": ("@/a.csv", ("a.csv: no force",), {"a.csv": GOOD.replace("force_n", "current_a", 1)}),
    "no position": ("@/a.csv", ("a.csv: no column 'position_m'",), {"a.csv": GOOD.replace("_m,", "_d,", 1)}),
    "empty file": ("@/a.csv", ("a.csv: empty file",), {"a.csv": ""}),
    "header only": ("@/a.csv", ("a.csv: 0 sample(s)",), {"a.csv": HEADER}),
    "no header": ("@/a.csv", ("a.csv: line 1", "header"), {"a.csv": "0,0,0\n1,1,1\n"}),
    "no file": ("@/none.csv", ("none.csv", "No such file"), {}),
    "other suffix": ("@/a.txt", ("suffix '.txt'", ".csv"), {"a.txt": GOOD}),
    "no parquet": ("@/a.parquet", ("a.parquet", "Parquet"), {"a.parquet": "PAR?"}),
    "no mcap": ("@/a.mcap", ("a.mcap", "MCAP"), {"a.mcap": "nothing"}),
    "two files": ("@/a.csv @/b.csv", ("b.csv", "--together"), {"a.csv": GOOD, "b.csv": GOOD}),
    "together alone": ("@/a.csv --together", ("at least two",), {"a.csv": GOOD}),
    "together, one is bad": ("@/in --together", ("b.csv: empty",), {"in/a.csv": GOOD, "in/b.csv": ""}),
    "together, other rate": ("@/in --together", ("b.csv", "one rate"), {"in/a.csv": GOOD, "in/b.csv": SLOW}),
    "folder without recordings": ("@/in", ("in: no recording", ".csv"), {"in/a.txt": ""}),
    "folder of bad ones": ("@/in", ("a.csv: empty file",), {"in/a.csv": ""}),
    "out is a file": ("@/a.csv", ("out", "is a file"), {"a.csv": GOOD, "out": "precious"}),
    "out under a file": ("@/a.csv --out @/a.csv/out", ("out", "can be written"), {"a.csv": GOOD}),
    "folder, out is a file": ("@/in", ("out", "is a file"), {"in/a.csv": GOOD, "out": "precious"}),
    "earlier results": ("@/a.csv", ("earlier diagnosis", "--over"), {"a.csv": GOOD, "out/report.html": "x"}),
    "earlier summary": ("@/in", ("earlier diagnosis", "--over"), {"in/a.csv": GOOD, "out/summary.json": "x"}),
    "model missing": ("@/a.csv --model @/m.yaml", ("m.yaml", "No such file"), {"a.csv": GOOD}),
    "model broken": ("@/a.csv --model @/m.yaml", ("m.yaml", "schema"), {"a.csv": GOOD, "m.yaml": "a: 1\n"}),
    "jobs": ("@/in --jobs 0", ("--jobs",), {"in/a.csv": GOOD}),
    "scheduler of a file": ("@/a.csv --scheduler x:1", ("--scheduler", "a folder"), {"a.csv": GOOD}),
    "scheduler malformed": ("@/in --scheduler here", ("--scheduler 'here'", "tcp://"), {"in/a.csv": GOOD}),
    "scheduler silent": ("@/in --scheduler 127.0.0.1:1", ("127.0.0.1:1", "refused"), {"in/a.csv": GOOD}),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "words", "files"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line_and_leaves_nothing_behind(
    run: Run,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: str,
    words: tuple[str, ...],
    files: dict[str, str],
) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    before = contents(tmp_path)
    out = "" if "--out" in arguments else " --out @/out"
    assert run(f"{arguments}{out}".replace("@", str(tmp_path)).split()) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    lines = [line for line in shown.err.splitlines() if not line.startswith("skipped: ")]
    assert len(lines) == 1
    assert lines[0].startswith("forefeel: ")
    for word in words:
        assert word in lines[0]
    assert contents(tmp_path) == before


def test_a_cluster_without_its_extra_is_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path / "a.csv", made(5.0))
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run([str(tmp_path), "--scheduler", "tcp://127.0.0.1:8786", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == "forefeel: --scheduler: needs dask: pip install forefeel[cluster]\n"
    assert not (tmp_path / "out").exists()


CLUSTER = """
    import sys
    from distributed import LocalCluster
    from forefeel.__main__ import main
    if __name__ == "__main__":
        with LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, host="127.0.0.1", protocol="tcp://",
            dashboard_address=None,
        ) as cluster:
            sys.argv = ["forefeel", "diagnose", *sys.argv[1:], "--scheduler", cluster.scheduler_address]
            main()
"""


@pytest.mark.soak
def test_a_cluster_does_a_folder(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    (tmp_path / "in").mkdir()
    put(tmp_path / "in" / "a.csv", made(5.0))
    (tmp_path / "in" / "b.csv").write_text("")
    words = [str(tmp_path / "in"), "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(CLUSTER), *words],
        capture_output=True, text=True, timeout=50, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert names(tmp_path / "out" / "a") == FILES
    assert "1 of 2 diagnosed, 1 skipped, 0 failed" in done.stdout
    assert "b.csv: empty file" in done.stderr


@pytest.mark.parametrize(
    "folder", [pytest.param(False, marks=pytest.mark.soak), True], ids=["file", "folder"]
)
def test_an_interrupt_leaves_nothing_half_written(tmp_path: Path, folder: bool) -> None:
    (tmp_path / "in").mkdir()
    for name in "ab":
        put(tmp_path / "in" / f"{name}.csv", made(60.0, friction_n=FRICTION_N, bias_n=0.05))
    source = [str(tmp_path / "in"), "--jobs", "2"] if folder else [str(tmp_path / "in" / "a.csv")]
    command = [sys.executable, "-m", "forefeel", "diagnose", *source, "--out", str(tmp_path / "new" / "out")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        deadline = time.monotonic() + 30.0
        while not (tmp_path / "new" / "out").exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers get it, too
        _, said = process.communicate(timeout=30)
    assert process.returncode == 1
    assert said.splitlines()[-1] == "forefeel: diagnosis interrupted; nothing was written", said
    assert "Traceback" not in said
    assert not (tmp_path / "new").exists()


@pytest.mark.soak
def test_a_run_is_diagnosed_by_its_readback(run: Run, tmp_path: Path) -> None:
    whole = made(4.0, friction_n=FRICTION_N)
    assert whole.force_n is not None
    samples = [
        force(10 * k, position_m=float(x), force_n=float(f))
        for k, (x, f) in enumerate(zip(whole.position_m, whole.force_n, strict=True))
    ]
    write_forces(tmp_path / "run.mcap", samples)
    put(tmp_path / "same.csv", recording(whole.time_s, whole.position_m, whole.force_n))
    for name in ("run.mcap", "same.csv"):
        assert run([str(tmp_path / name), "--out", str(tmp_path / name.partition(".")[0])]) == 0
    one, two = (json.loads((tmp_path / name / "diagnosis.json").read_text()) for name in ("run", "same"))
    assert one["verdict"] == two["verdict"] == "cause_found"
    assert one["held_out"]["rmse_after_n"] == pytest.approx(two["held_out"]["rmse_after_n"], rel=1e-3)


@pytest.mark.soak
def test_of_several_axes_one_is_named(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    whole = made(5.0)
    assert whole.force_n is not None
    with RunWriter(tmp_path / "run.mcap") as writer:
        for k, (x, f) in enumerate(zip(whole.position_m, whole.force_n, strict=True)):
            for axis in ("insertion", "rotation"):
                put_message(writer, force(10 * k, position_m=float(x), force_n=float(f)), axis=axis)
    words = [str(tmp_path / "run.mcap"), "--out", str(tmp_path / "out")]
    assert run(words) == 2
    assert "insertion, rotation" in capsys.readouterr().err
    assert run([*words, "--axis", "insertion"]) == 0
    assert names(tmp_path / "out") == FILES
