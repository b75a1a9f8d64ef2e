"""`forefeel evaluate` as a person uses it."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Prepared, prepare
from tests.commands.command_line import contents, refused
from tests.unit.evaluation_samples import csv_text, made_up, recording
from tests.unit.page_checks import check_page

Run = Callable[[Sequence[str]], int]
MODEL = "schema: forefeel.model/1\nname: spring only\neffects:\n  - effect: mass_damper_spring\n"


def put(folder: Path, name: str, of: Recording) -> str:
    (folder / name).write_text(csv_text(of))
    return str(folder / name)


def document(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "evaluation.json").read_text())
    return found


def test_good_files_are_evaluated_and_bad_ones_skipped(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    whole = made_up(duration_s=6.0)
    files = [
        put(tmp_path, "contact.csv", whole),
        put(tmp_path, "short.csv", made_up(duration_s=1.0, gap_s=0.0)),
        put(tmp_path, "free.csv", recording(whole.time_s, whole.position_m, None)),
        str(tmp_path / "missing.csv"),
    ]
    (tmp_path / "broken.csv").write_text("time_s,position_m,force_n\n0,0,1\n0.01,x,1\n")
    unclear = tmp_path / "unclear.csv"
    unclear.write_text(Path(files[0]).read_text().replace("position_m", "position"))
    out = tmp_path / "new" / "out"
    files += [str(tmp_path / "broken.csv"), str(unclear)]
    assert run(["evaluate", *files, "--delays", "20:300", "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert sorted(path.name for path in out.iterdir()) == ["evaluation.html", "evaluation.json"]
    found = document(out)
    assert list(found["recordings"]) == ["contact"]  # type: ignore[call-overload]
    skipped = found["skipped"]
    assert isinstance(skipped, dict)
    assert set(skipped) == {"short", "free", "missing", "broken", "unclear"}
    assert f"type: forefeel evaluate {unclear} --position m:position" in skipped["unclear"]
    assert "at least 3.3 s" in skipped["short"]
    assert "no force" in skipped["free"]
    assert "No such file" in skipped["missing"]
    assert "line 3" in skipped["broken"]
    assert shown.err.count("skipped: ") == 5
    row = next(line for line in shown.out.splitlines() if line.startswith("| contact"))
    methods = found["recordings"]["contact"]["methods"]  # type: ignore[index]
    for name in "paper", "mbk_bias", "forefeel":
        assert f"({methods[name]['rms_n'] / methods['zoh']['rms_n']:.3f})" in row
    assert row.rstrip(" |").endswith(f"{abs(1e3 * methods['forefeel']['offset_s']):.0f} ms late")
    by_delay = found["recordings"]["contact"]["by_delay"]  # type: ignore[index]
    assert [each["delay_s"] for each in by_delay] == pytest.approx([0.02, 0.06, 0.12, 0.25, 0.3])
    assert by_delay[-1]["rms_n"]["zoh"] == methods["zoh"]["rms_n"] > by_delay[0]["rms_n"]["zoh"]
    check_page((out / "evaluation.html").read_text(), figures=3)
    assert "\x1b" not in shown.out + shown.err


def test_page_stands_alone_in_folder_named_after_file(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    files = [put(tmp_path, "<script>x.csv", made_up(duration_s=6.0)), "none.csv"]
    assert run(["evaluate", *files]) == 0
    page = (tmp_path / "<script>x" / "evaluation.html").read_text()
    assert "<script>x" not in page
    check_page(page, figures=2)
    assert "none.csv" in page


def test_the_same_command_gives_the_same_bytes_and_overwrites_only_when_asked(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    line = ["evaluate", put(tmp_path, "a.csv", made_up(duration_s=5.0)), "--jitter", "50", "--loss", "0.05"]
    line += ["--seed", "3", "--out", str(out)]
    assert run(line) == 0
    before = contents(out)
    (out / "notes.txt").write_text("mine")
    assert run(line) == 2
    assert "holds an earlier evaluation" in capsys.readouterr().err
    assert run([*line, "--overwrite"]) == 0
    assert contents(out) == {**before, out / "notes.txt": b"mine"}
    assert (document(out)["jitter_s"], document(out)["loss"], document(out)["seed"]) == (0.05, 0.05, 3)
    assert run([*line, "--overwrite", "--seed", "4"]) == 0
    assert contents(out)[out / "evaluation.json"] != before[out / "evaluation.json"]


def test_each_delay_of_a_range_is_prepared_once(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    delays_s = list[float]()

    def counted(sample: Recording, link: DelayedLink, *model: ContactModel | None) -> Prepared:
        delays_s.append(link.delay_s)
        return prepare(sample, link, *model)

    for module in "evaluation.run", "diagnosis.evaluation.evaluate":
        monkeypatch.setattr(f"forefeel.{module}.prepare", counted)
    line = ["evaluate", put(tmp_path, "a.csv", made_up(duration_s=5.0)), "--out", str(tmp_path / "out")]
    assert run([*line, "--delays", "200:400"]) == 0
    assert sorted(delays_s) == pytest.approx([0.2, 0.25, 0.3, 0.4])


GOOD, SHORT = csv_text(made_up(duration_s=4.0)), csv_text(made_up(duration_s=1.0))
BAD = {
    "nothing to evaluate": ("@/a.csv", ("a.csv", "at least 3.3 s"), {"a.csv": SHORT}),
    "no file": ("", ("FILE",), {}),
    "a folder": ("@", ("suffix",), {}),
    "one stem twice": ("@/a.csv @/b/a.csv", ("2 files", "'a'"), {"a.csv": GOOD, "b/a.csv": GOOD}),
    "delay negative": ("@/a.csv --delays -1000", ("delay_s = -1",), {"a.csv": GOOD}),
    "unit": ("@/a.csv --force V:load", ("force = 'V:load'",), {"a.csv": GOOD}),
    "model that learns nothing": (
        "@/a.csv --model @/m.yaml",
        ("m.yaml", "no linear parameter"),
        {"a.csv": GOOD, "m.yaml": MODEL.replace("mass_damper_spring", "contact_loss")},
    ),
    "out is a file": ("@/a.csv", ("out", "is a file"), {"a.csv": GOOD, "out": "precious"}),
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
    refused(run, capsys, tmp_path, f"evaluate {arguments} --out @/out", words, files)
