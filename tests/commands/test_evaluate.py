"""`forefeel evaluate` as a person uses it."""

import json
from typing import Any

import pytest

from forefeel.common.recording.mcap_reader import Run
from tests.commands.command_line import contents
from tests.commands.conftest import Shell
from tests.unit.evaluation_samples import csv_text, made_up, recording
from tests.unit.page_checks import check_page

MODEL = "schema: forefeel.model/1\nname: spring only\neffects:\n  - effect: mass_damper_spring\n"


def test_good_files_are_evaluated_and_bad_ones_skipped(shell: Shell) -> None:
    whole = made_up(duration_s=6.0)
    files = {
        "contact": csv_text(whole),
        "short": csv_text(made_up(duration_s=1.0, gap_s=0.0)),
        "free": csv_text(recording(whole.time_s, whole.position_m, None)),
        "broken": "time_s,position_m,force_n\n0,0,1\n0.01,x,1\n",
        "unclear": csv_text(whole).replace("position_m", "position"),
    }
    shell.write({f"{name}.csv": text for name, text in files.items()})
    out = shell.folder / "new" / "out"
    names = " ".join(f"{name}.csv" for name in (*files, "missing"))
    shown = shell(f"evaluate {names} --delays 20:450 --out {out}")
    assert shown.code == 0
    assert sorted(path.name for path in out.iterdir()) == ["evaluation.html", "evaluation.json"]
    found: Any = json.loads((out / "evaluation.json").read_text())
    assert list(found["recordings"]) == ["contact"]
    skipped = found["skipped"]
    assert set(skipped) == {"short", "free", "missing", "broken", "unclear"}
    assert "type: forefeel evaluate unclear.csv --position m:position" in skipped["unclear"]
    assert "at least 3.45 s" in skipped["short"]
    assert "no force" in skipped["free"]
    assert "No such file" in skipped["missing"]
    assert "line 3" in skipped["broken"]
    assert shown.err.count("skipped: ") == 5
    delays = [line for line in shown.err.splitlines() if line.startswith("contact: replaying")]
    assert delays == [f"contact: replaying, delay {number} of 6" for number in range(1, 7)]
    row = next(line for line in shown.out.splitlines() if line.startswith("| contact"))
    methods, by_delay = (found["recordings"]["contact"][name] for name in ("methods", "by_delay"))
    for name in "paper", "mbk_bias", "forefeel":
        assert f"({methods[name]['rms_n'] / methods['zoh']['rms_n']:.3f})" in row
    assert row.rstrip(" |").endswith(f"{abs(1e3 * methods['forefeel']['offset_s']):.0f} ms late")
    assert [each["delay_s"] for each in by_delay] == pytest.approx([0.02, 0.06, 0.12, 0.25, 0.3, 0.45])
    assert by_delay[-2]["rms_n"]["zoh"] == methods["zoh"]["rms_n"] > by_delay[0]["rms_n"]["zoh"]
    check_page((out / "evaluation.html").read_text(), figures=3)
    assert "\x1b" not in shown.out + shown.err


def test_page_stands_alone_in_folder_named_after_file(shell: Shell) -> None:
    (shell.folder / "<script>x.csv").write_text(csv_text(made_up(duration_s=6.0)))
    assert shell("evaluate <script>x.csv none.csv").code == 0
    page = (shell.folder / "<script>x" / "evaluation.html").read_text()
    assert "<script>x" not in page
    check_page(page, figures=2)
    assert "none.csv" in page


def test_the_same_command_gives_the_same_bytes_and_overwrites_only_when_asked(shell: Shell) -> None:
    shell.write({"a.csv": csv_text(made_up(duration_s=5.0))})
    out, line = shell.folder / "out", "evaluate a.csv --jitter 50 --loss 0.05 --seed 3 --out out"
    assert shell(line).code == 0
    before = contents(out)
    shell.refused(line, ("holds an earlier evaluation",), {"out/notes.txt": "mine"})
    assert shell(f"{line} --overwrite").code == 0
    assert contents(out) == {**before, out / "notes.txt": b"mine"}
    found = json.loads((out / "evaluation.json").read_text())
    assert (found["jitter_s"], found["loss"], found["seed"]) == (0.05, 0.05, 3)
    assert shell(f"{line} --overwrite --seed 4").code == 0
    assert contents(out)[out / "evaluation.json"] != before[out / "evaluation.json"]


def test_the_next_command_plays_the_file_that_was_evaluated_with_its_model(shell: Shell) -> None:
    whole = csv_text(made_up(duration_s=5.0)).replace("position_m", "where")
    shell.write({"a.csv": whole, "m.yaml": MODEL})
    shown = shell("evaluate a.csv --position m:where --model m.yaml --out out")
    line = shown.err.splitlines()[-1].removeprefix("next: forefeel ")
    assert shell(f"{line} --virtual-time --duration 2 --out played").code == 0
    run = Run(shell.folder / "played" / "recording.mcap").metadata["run"]
    assert (run["recording"], run["master_model"]) == ("a.csv", "m.yaml")


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
    shell: Shell, arguments: str, words: tuple[str, ...], files: dict[str, str]
) -> None:
    shell.refused(f"evaluate {arguments} --out @/out", words, files)
