"""The diagnosis on forces that imports nothing of ours, and on measured ones."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from forefeel.cli import app
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.noise import autoregression

RATE_HZ = 500.0


def _motion(seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Strokes of a hand: several amplitudes and speeds, with a dwell now and then."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    x = 8e-3 * np.sin(2 * np.pi * 0.23 * t) + 3e-3 * np.sin(2 * np.pi * 0.71 * t + 1.0)
    x += 1e-3 * np.sin(2 * np.pi * 1.9 * t + 2.0) + 2e-4 * np.sin(2 * np.pi * 8.3 * t)
    return t, np.asarray(x)


def _recording(friction_n: float, bias_n: float = 0.0) -> Recording:
    t, x = _motion(30.0)
    v, noise = np.gradient(x, t), np.random.default_rng(5).standard_normal(len(t))
    for k in range(1, len(noise)):  # a corner of some 20 Hz
        noise[k] = 0.78 * noise[k - 1] + 0.626 * noise[k]
    force = 0.02 * np.gradient(v, t) + 0.8 * v + 30.0 * x + friction_n * np.tanh(v / 2e-4) + bias_n
    return Recording("made", t, x, np.asarray(force + 0.002 * noise), "test")


def test_dry_friction_is_named_with_its_force_and_nothing_else() -> None:
    found = diagnose(_recording(friction_n=0.06)).diagnosis
    assert found.verdict == "cause_found"
    assert [cause.name for cause in found.causes] == ["coulomb_friction"]
    assert found.held_out.gain_low > 0.5


def test_a_bias_alone_is_a_cause() -> None:
    found = diagnose(_recording(friction_n=0.0, bias_n=0.05)).diagnosis
    assert (found.verdict, [cause.name for cause in found.causes]) == ("cause_found", ["bias"])


def test_where_nothing_is_hidden_nothing_is_named() -> None:
    found = diagnose(_recording(friction_n=0.0)).diagnosis
    assert (found.verdict, found.causes) == ("nothing_missing", ())


@pytest.mark.soak
def test_the_command_leaves_numbers_page_and_model_and_refuses_what_is_too_short(tmp_path: Path) -> None:
    recording = _recording(friction_n=0.06)
    assert recording.force_n is not None
    columns = np.column_stack([recording.time_s, recording.position_m, recording.force_n])
    for name, rows in (("strokes", columns), ("short", columns[:600])):
        np.savetxt(
            tmp_path / f"{name}.csv", rows, delimiter=",", header="time_s,position_m,force_n", comments=""
        )
    runner = CliRunner()
    done = runner.invoke(app, ["diagnose", str(tmp_path / "strokes.csv"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["schema"] == "forefeel.diagnosis/1"
    assert [cause["name"] for cause in document["causes"]] == ["coulomb_friction"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "diagnosis.json",
        "report.html",
        "model.yaml",
    }


def test_noise_is_learned_between_samples_that_mean_nothing() -> None:
    """A colour of twelve taps would leave no row between holes that are nine samples apart."""
    rng, rows = np.random.default_rng(1), np.ones(900, dtype=np.bool_)
    rows[::10] = False
    noise = autoregression(rng.standard_normal(900), rows, [slice(0, 900)], 100.0)
    assert 2 * np.count_nonzero(noise.rows(rows, [slice(0, 900)])) >= np.count_nonzero(rows)
