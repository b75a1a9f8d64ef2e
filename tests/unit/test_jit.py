"""Kernels as plain Python give what compiled ones give; what numba kept of other sources is not used."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import forefeel.common
from forefeel.common import jit


def _predicted() -> list[float]:
    """What is predicted of a spring with friction whose forces are 100 ms late."""
    predictor = import_module("forefeel.common.estimation.predictor").Predictor()
    said = list[float]()
    rng = np.random.default_rng(1)
    x = 5e-3 * np.sin(2.0 * np.pi * 0.7e-3 * np.arange(400))
    forces_n = 60.0 * x + 0.05 * np.sign(np.gradient(x)) + 0.01 * rng.standard_normal(400)
    for n in range(400):
        if n > 100:
            predictor.observe((n - 100) * 1e-3, forces_n[n - 100])
        predictor.move(n * 1e-3, x[n])
        if (estimate := predictor.predict()) is not None:
            said += estimate[:3]
    return said


def test_plain_python_predicts_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = _predicted()
    for name in ("jit", "estimation"):
        monkeypatch.setattr(forefeel.common, name, getattr(forefeel.common, name))
    for name in [
        n for n in sys.modules if n.startswith(("forefeel.common.jit", "forefeel.common.estimation"))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setenv("FOREFEEL_JIT", "0")
    plain = _predicted()
    assert not sys.modules["forefeel.common.jit"].COMPILED
    assert len(plain) == len(compiled) > 500
    np.testing.assert_allclose(plain, compiled, atol=1e-9)


def test_kernels_of_other_sources_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "common" / "jit.py"))
    source = tmp_path / "common" / "causes" / "wall.py"
    kept = tmp_path / "common" / "estimation" / "__pycache__" / "steps.move.nbi"
    for path in (source, kept):
        path.parent.mkdir(parents=True)
    source.write_text("a = 1\n")
    forget = jit._remove_stale_code.__wrapped__
    forget()
    kept.write_text("of the same sources")
    forget()
    assert kept.exists()
    source.write_text("a = 2\n")
    forget()
    assert not kept.exists()
