"""`forefeel simulate` as a person uses it."""

import numpy as np
import pytest

from forefeel.common.recording.loading import load_recording
from tests.commands.conftest import Shell

MODEL = "schema: forefeel.model/1\nname: a spring\neffects:\n  - effect: mass_damper_spring\n"
SIMULATE = "simulate --model model.yaml"


@pytest.fixture(autouse=True)
def model(shell: Shell) -> None:
    shell.write({"model.yaml": MODEL})


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_recording_is_made_and_can_be_read(shell: Shell, suffix: str) -> None:
    out = shell.folder / "new" / f"run.{suffix}"
    shown = shell(f"{SIMULATE} --duration 2 --rate 500 --seed 4 --out {out}")
    assert shown.code == 0
    found = load_recording(out)
    assert found.force_n is not None
    assert len(found) == 1001
    assert found.duration_s == pytest.approx(2.0)
    assert shown.out.startswith(f"{out}: 1001 samples over 2 s of 'a spring', force ")
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
        ("--time ms:t", ("ms:t", "--motion")),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(shell: Shell, line: str, words: tuple[str, ...]) -> None:
    (shell.folder / "folder.csv").mkdir()
    shell.refused(f"{SIMULATE} --out run.csv {line}", words)


def test_a_recording_with_columns_of_its_own_is_followed(shell: Shell) -> None:
    rows = "\n".join(f"{n},{0.5 * n:.1f},7" for n in range(400))
    line = f"{SIMULATE} --motion laser.csv --noise 0 --out run.csv"
    shell.refused(line, files={"laser.csv": f"t,laser,load\n{rows}\n"})
    assert shell(f"{line} --time ms:t --position mm:laser").code == 0
    found = load_recording(shell.folder / "run.csv")
    assert len(found) == 400
    assert found.duration_s == pytest.approx(0.399)
    assert found.position_m[-1] == pytest.approx(0.1995, abs=0.005)  # behind the low-pass


def test_rows_without_a_time_have_the_rate_of_the_samples(shell: Shell) -> None:
    rows = "\n".join(f"{0.5 * n:.1f}" for n in range(401))
    line = f"{SIMULATE} --motion laser.csv --out run.csv"
    shell.refused(line, ("--rate",), {"laser.csv": f"position_mm\n{rows}\n"})
    assert shell(f"{line} --rate 200").code == 0
    found = load_recording(shell.folder / "run.csv")
    assert len(found) == 401
    assert found.duration_s == pytest.approx(2.0)


def test_a_preset_is_a_model(shell: Shell) -> None:
    assert shell("simulate --model guidewire --duration 2 --out wire.csv").code == 0
    force_n = load_recording(shell.folder / "wire.csv").force_n
    assert force_n is not None
    assert 0.003 < np.ptp(force_n) < 0.2
