"""Kernels as plain Python give what compiled ones give; what numba kept of other sources is not used."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.causes.registry import effect_class
from forefeel.common.causes.runtime import ContactRuntime
from forefeel.common.estimation.forecast import Forecaster

ROOT = Path(__file__).parents[2]
ASK = "import json; from tests.unit import test_jit as t; print(json.dumps(t.predicted() + t.forces()))"
EFFECTS = "presliding_hysteresis", "backlash", "sensor_lag", "unmodelled_resonance", "stress_relaxation"


def predicted() -> list[float]:
    """What is predicted of a spring with friction whose forces are 100 ms late."""
    forecaster, said = Forecaster(), list[float]()
    rng = np.random.default_rng(1)
    x = 5e-3 * np.sin(2.0 * np.pi * 0.7e-3 * np.arange(400))
    forces_n = 60.0 * x + 0.05 * np.sign(np.gradient(x)) + 0.01 * rng.standard_normal(400)
    for n in range(400):
        if n > 100:
            forecaster.observe((n - 100) * 1e-3, forces_n[n - 100])
        forecaster.move(n * 1e-3, x[n])
        if (estimate := forecaster.predict()) is not None:
            said += estimate[:3]
    return said


def forces() -> list[float]:
    """What effects with a loop over time make of a motion."""
    t = np.linspace(0.0, 0.499, 500)
    x, v, a = (5e-3 * np.sin(2.0 * np.pi * 2.0 * t + phase) for phase in (0.0, 0.5 * np.pi, np.pi))
    effects = [effect_class(name) for name in EFFECTS]
    made = [kind(**{p.name: max(p.default, p.lower, 1e-3) for p in kind.parameters}) for kind in effects]
    runtimes = [ContactRuntime([(each, None)]) for each in made]
    return [float(f) for each in runtimes for f in each.forces_n(t, x, v, a)]


@pytest.mark.parametrize("switch", ["FOREFEEL_JIT=0", "NUMBA_DISABLE_JIT=1"])
def test_plain_python_gives_the_same(switch: str) -> None:
    name, _, value = switch.partition("=")
    done = subprocess.run(
        [sys.executable, "-c", ASK],
        env={**os.environ, name: value}, cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    plain, compiled = np.array(json.loads(done.stdout)), np.array(predicted() + forces())
    assert len(plain) == len(compiled) > 1000
    assert np.abs(plain - compiled).max() < 1e-9


def test_what_was_compiled_from_other_sources_is_removed(tmp_path: Path) -> None:
    for name in ("forefeel", "common", "master", "slave"):
        shutil.copytree(
            ROOT / name, tmp_path / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    kept = tmp_path / "common" / "estimation" / "forecast" / "__pycache__" / "steps.move.nbi"
    kept.parent.mkdir()

    (tmp_path / "one.py").write_text(
        "from forefeel.common.jit import kernel\n\n@kernel\ndef same(x):\n    return x\n"
    )

    def compiles() -> None:
        command = [sys.executable, "one.py"]
        subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)}, check=True)

    compiles()
    kept.write_text("of the same sources")
    compiles()
    assert kept.exists()
    callee = tmp_path / "common" / "estimation" / "forecast" / "band.py"
    callee.write_text(callee.read_text() + "\n")
    compiles()
    assert not kept.exists()
