"""`forefeel reproduce` from the command line to its files."""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forefeel.__main__ import main
from forefeel.studies.paper import bench, memory, windup
from forefeel.studies.paper import run as reproduction
from forefeel.studies.paper.recordings import recorded_runs
from tests.simulation.pair import write_csv
from tests.unit.page_checks import check_page

FIGURES = [4, 5, 7, 8, 9, 10]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[[Sequence[str]], int]:
    """Runs the command line in this process as the installed script does; its exit code."""
    monkeypatch.delenv("FOREFEEL_DATA", raising=False)

    def run(arguments: Sequence[str]) -> int:
        monkeypatch.setattr(sys, "argv", ["forefeel", "reproduce", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code if isinstance(ended.value.code, int) else 0

    return run


def recordings(folder: Path) -> Path:
    """A good one, one without force, a short one, a broken one, and something else."""
    folder.mkdir()
    time_s = np.arange(0.0, 8.0, 0.02)
    x = 0.01 * np.sin(2.0 * time_s) + 0.003 * np.sin(7.0 * time_s)
    force = 1.0 - 50.0 * x - 0.1 * np.cos(2.0 * time_s)  # as the reaction: it drives the motion
    write_csv(folder / "good.csv", "time_s,position_m,force_n", [time_s, x, force])
    write_csv(folder / "motion.csv", "time_s,position_m", [time_s, x])
    write_csv(folder / "short.csv", "time_s,position_m,force_n", [time_s[:50], x[:50], force[:50]])
    (folder / "broken.csv").write_text("time_s,position_m,force_n\n0,0,far\n1,0,0\n")
    (folder / "README.md").write_text("not a recording")
    return folder


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}


@pytest.mark.soak
def test_the_command_writes_figures_page_and_numbers_and_keeps_an_earlier_result(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(reproduction, "STYLES", {"normal": bench.STYLES["normal"]})
    monkeypatch.setattr(windup, "LAMBDAS", (0.96,))
    monkeypatch.setattr(windup, "SEEDS", 1)
    monkeypatch.setattr(memory, "SEEDS", 1)
    monkeypatch.setattr(memory, "DURATION_S", 6.0)
    out = tmp_path / "out"
    line = ["--out", str(out), "--duration", "6", "--recordings", str(recordings(tmp_path / "measured"))]
    assert run(line) == 0
    shown = capsys.readouterr()
    assert "reproduce: simulated bench: guidewire, normal, 6 s" in shown.err
    assert "Figures 7, 8: catheter, simulated bench" in shown.out
    check_numbers(json.loads((out / "reproduction.json").read_text()))
    check_files(out)

    before = contents(out)
    assert run(line) == 2
    again = capsys.readouterr()
    assert (again.out, again.err.count("\n")) == ("", 1)
    assert "--overwrite" in again.err
    assert contents(out) == before


def check_numbers(numbers: dict[str, Any]) -> None:
    assert numbers["schema"] == "forefeel.reproduction/1"
    assert [figure["figure"] for figure in numbers["simulated"]] == [4, 5]
    assert [one["instrument"] for one in numbers["bench"]] == ["catheter", "guidewire"]
    for one in numbers["bench"]:
        assert one["round_trip_s"] == pytest.approx(0.3, abs=0.02)
        errors = [one[name]["error"]["rms_n"] for name in ("without_delay", "product", "zoh")]
        assert 0.0 < errors[0] < errors[2]  # what is not late is better
        assert errors[1] > 0.0
        assert one["force_peak_n"] < (1.0 if one["instrument"] == "catheter" else 0.1)
        assert set(one["delayed_rms_by_rate_hz"]) == {"1000", "100", "10"}
    baseline = numbers["flaws"]["baseline"]
    assert [row["name"] for row in baseline["rows"]] == ["catheter, normal", "guidewire, normal", "good"]
    assert baseline["recordings_given"]
    assert {name: bool(why) for name, why in baseline["skipped"].items()} == {
        "broken": True,
        "motion": True,
        "short": True,
    }
    good = baseline["rows"][2]
    assert good["product_over_zoh"] < 1.0  # it resists the motion only when turned
    assert good["tared_over_zoh"] < good["paper_over_zoh"]  # of an offset of 1 N
    scales = {(row["instrument"], row["force_scale"]) for row in numbers["thresholds"]["rows"]}
    assert scales == {("catheter", 1.0), ("guidewire", 10.0)}
    for row in numbers["thresholds"]["rows"]:
        assert 0.0 <= row["absolute_share"] <= row["strict_share"] <= row["lenient_share"] <= 1.0


def check_files(out: Path) -> None:
    names = {f"figure_{figure:02}.png" for figure in FIGURES} | {f"flaw_{letter}.png" for letter in "abcdef"}
    names |= {"thresholds.png", "reproduction.html", "reproduction.json"}
    assert {path.name for path in out.iterdir()} == names
    for path in out.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
    page = (out / "reproduction.html").read_text()
    check_page(page, drawings=13)
    assert page.count("simulated bench") > 10


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("", ("--out",)),
        ("--out @/file", ("file", "is a file")),
        ("--out @/file/deeper", ("deeper", "Not a directory")),
        ("--out @/new --recordings @/none", ("--recordings", "none", "no such folder")),
        ("--out @/new --recordings @/file", ("--recordings", "no such folder")),
        ("--out @/new --seed -1", ("--seed",)),
        ("--out @/new --duration 2", ("--duration",)),
        ("--out @/new --duration nan", ("--duration",)),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing_behind(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: str,
    words: tuple[str, ...],
) -> None:
    (tmp_path / "file").write_text("precious")
    assert run(arguments.replace("@", str(tmp_path)).split()) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    for word in words:
        assert word in shown.err
    assert contents(tmp_path).keys() == {"file"}


def test_the_variable_names_a_folder_of_recordings(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setenv("FOREFEEL_DATA", str(tmp_path / "none"))
    assert run(["--out", str(tmp_path / "out")]) == 2
    assert "FOREFEEL_DATA" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.soak
def test_on_measured_recordings_the_hold_stands_beside_the_paper(data_dir: Path) -> None:
    """The measured hold at 300 ms of these files, worked out independently of this code."""
    from forefeel.studies.paper.replay import baseline_row, replay

    said: list[str] = []
    runs, skipped = recorded_runs([data_dir], said.append)
    assert set(skipped) == {"human_motion"}
    run = next(run for run in runs if run.name == "presliding_friction")
    row = baseline_row(replay(run, 0.3))
    time_s, force_n = run.recording.time_s, run.force_n
    errors = [
        force_n[i] - force_n[time_s <= t - 0.3 + 1e-6][-1]
        for i, t in enumerate(time_s)
        if t >= time_s[0] + 3.3 - 1e-9
    ]
    assert row.zoh.rms_n == pytest.approx(float(np.sqrt(np.mean(np.square(errors)))), rel=1e-3)
    assert row.product_over_zoh is not None
    assert row.product_over_zoh < 1.0
