"""`forefeel simulate` as a person uses it."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.recording.loading import load_recording
from tests.commands.command_line import refused

Run = Callable[[Sequence[str]], int]
MODEL = "schema: forefeel.model/1\nname: a spring\neffects:\n  - effect: mass_damper_spring\n"


@pytest.fixture(autouse=True)
def model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.yaml").write_text(MODEL)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_recording_is_made_and_can_be_read(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, suffix: str
) -> None:
    out = tmp_path / "new" / f"run.{suffix}"
    words = ["simulate", "--model", "model.yaml", "--duration", "2", "--rate", "500", "--seed", "4"]
    assert run([*words, "--out", str(out)]) == 0
    found = load_recording(out)
    assert found.force_n is not None
    assert len(found) == 1001
    assert found.duration_s == pytest.approx(2.0)
    assert capsys.readouterr().out.startswith(f"{out}: 1001 samples over 2 s of 'a spring', force ")
    assert [path.name for path in out.parent.iterdir()] == [out.name]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--out run.txt", ("run.txt", ".parquet")),
        ("--out folder.csv", ("folder.csv", "is a folder")),
        ("--motion dance", ("--motion dance", "multisine")),
        ("--motion model.yaml", ("model.yaml", ".mcap")),
        ("--model none.yaml", ("none.yaml", "No such file")),
        ("--duration 86400 --rate 1e4", ("--duration and --rate", "8.64e+08")),
        *((option, option.split()) for option in ("--rate nan", "--duration 0", "--noise -1", "--depth inf")),
        ("--seed -1", ("--seed",)),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str, words: tuple[str, ...]
) -> None:
    (tmp_path / "folder.csv").mkdir()
    refused(run, capsys, tmp_path, f"simulate --model model.yaml --out run.csv {line}", words, {})


def test_a_recording_with_columns_of_its_own_is_followed(run: Run, tmp_path: Path) -> None:
    rows = "\n".join(f"{n},{0.5 * n:.1f},7" for n in range(400))
    (tmp_path / "laser.csv").write_text(f"t,laser,load\n{rows}\n")
    words = ["simulate", "--model", "model.yaml", "--motion", "laser.csv", "--noise", "0", "--out", "run.csv"]
    assert run(words) == 2
    assert run([*words, "--time", "ms:t", "--position", "mm:laser"]) == 0
    found = load_recording(tmp_path / "run.csv")
    assert len(found) == 400
    assert found.duration_s == pytest.approx(0.399)
    assert found.position_m[-1] == pytest.approx(0.1995, abs=0.005)  # behind the low-pass
    assert run(["simulate", "--model", "model.yaml", "--time", "ms:t", "--out", "other.csv"]) == 2
    assert not (tmp_path / "other.csv").exists()


def test_rows_without_a_time_have_the_rate_of_the_samples(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = "\n".join(f"{0.5 * n:.1f}" for n in range(401))
    (tmp_path / "laser.csv").write_text(f"position_mm\n{rows}\n")
    words = ["simulate", "--model", "model.yaml", "--motion", "laser.csv", "--out", "run.csv"]
    assert run(words) == 2
    assert "--rate" in capsys.readouterr().err
    assert run([*words, "--rate", "200"]) == 0
    found = load_recording(tmp_path / "run.csv")
    assert len(found) == 401
    assert found.duration_s == pytest.approx(2.0)


def test_parquet_without_pyarrow_says_what_to_install(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # as in a base install
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    given = tmp_path / "run.parquet"
    given.write_bytes(b"PAR1")
    assert run(["diagnose", str(given)]) == 2
    assert run(["simulate", "--model", "model.yaml", "--duration", "2", "--out", "new.parquet"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.endswith("needs pyarrow: pip install 'forefeel[formats]'") for line in lines)
    assert len(lines) == 2
    assert given.read_bytes() == b"PAR1"
    assert not (tmp_path / "new.parquet").exists()


def test_a_preset_is_a_model(run: Run, tmp_path: Path) -> None:
    assert run(["simulate", "--model", "guidewire", "--duration", "2", "--out", "wire.csv"]) == 0
    force_n = load_recording(tmp_path / "wire.csv").force_n
    assert force_n is not None
    assert 0.003 < np.ptp(force_n) < 0.2
