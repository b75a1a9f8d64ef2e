"""One update of recursive least squares beside its peers, and one tick of the predictor:
`python -m benchmarks.estimation`.

Every candidate gets the same samples in the same run, in turns; what is printed is the median over the turns
and its ratio to plain numpy. The peers are those of the `bench` extra; one that is not installed is left out.
"""

import os
import platform
import sys
import time
from collections.abc import Callable
from importlib import import_module, metadata
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.evaluator import Evaluator
from forefeel.common.estimation.learner import Learner
from forefeel.diagnosis.evaluation.rls import RecursiveLeastSquares

Array = NDArray[np.float64]
Update = Callable[[Array, Array], None]
"""Learns from the rows and the forces, all of them."""

_SAMPLES, _TURNS = 2000, 9  # updates in a turn, turns
_DT_S, _DELAY_SAMPLES = 1e-3, 300  # s between samples at 1 kHz, and by how many of them a force comes later


def main() -> None:
    """Prints three tables."""
    python = sys.version.split()[0]
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {python}, numpy {np.__version__}")
    for n in (3, 12):
        _updates(n)
    _ticks()


def _updates(n: int) -> None:
    rng = np.random.default_rng(n)
    rows = rng.standard_normal((_SAMPLES, n))
    forces = rows @ rng.standard_normal(n) + 0.01 * rng.standard_normal(_SAMPLES)
    candidates: dict[str, Update] = {
        "numpy, equations (9) to (12)": _numpy,
        "forefeel, safe, pure Python": _ours,
    }
    for name, peer in (("padasip", _padasip), ("filterpy", _filterpy), ("statsmodels", _statsmodels)):
        try:
            candidates[f"{name} {metadata.version(name)}"] = peer()
        except (ImportError, metadata.PackageNotFoundError):
            print(f"{name}: not installed (pip install 'forefeel[bench]')")
    _table(f"one update, {n} parameters", _in_turns(candidates, rows, forces))


def _in_turns(candidates: dict[str, Update], rows: Array, forces: Array) -> dict[str, float]:
    """Median microseconds for one update of each."""
    for update in candidates.values():
        update(rows[:50], forces[:50])
    took: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(_TURNS):
        for name, update in candidates.items():
            start_s = time.perf_counter()
            update(rows, forces)
            took[name].append((time.perf_counter() - start_s) / len(rows) * 1e6)
    return {name: float(np.median(turns)) for name, turns in took.items()}


def _table(title: str, took_us: dict[str, float]) -> None:
    reference_us = next(iter(took_us.values()))
    print(f"\n{title}")
    for name, us in sorted(took_us.items(), key=lambda row: row[1]):
        print(f"  {us:8.2f} us  {us / reference_us:6.2f} x  {name}")


def _numpy(rows: Array, forces: Array) -> None:
    """A textbook update without any safeguard."""
    n = rows.shape[1]
    theta, p, lam = np.zeros(n), 1e6 * np.eye(n), 0.999
    for phi, y in zip(rows, forces, strict=True):
        p_phi = p @ phi
        gain = p_phi / (lam + phi @ p_phi)
        theta += gain * (y - phi @ theta)
        p = (p - np.outer(gain, p_phi)) / lam


def _ours(rows: Array, forces: Array) -> None:
    """Gate, floor of information, UD form."""
    rls = RecursiveLeastSquares((1.0,) * rows.shape[1], 1.0)
    for phi, y in zip(rows.tolist(), forces.tolist(), strict=True):
        rls.update(phi, y, _DT_S)


def _padasip() -> Update:
    padasip: Any = import_module("padasip")

    def update(rows: Array, forces: Array) -> None:
        peer = padasip.filters.FilterRLS(rows.shape[1], mu=0.999)
        for phi, y in zip(rows, forces, strict=True):
            peer.adapt(y, phi)

    return update


def _filterpy() -> Update:
    filterpy: Any = import_module("filterpy.kalman")

    def update(rows: Array, forces: Array) -> None:
        n = rows.shape[1]
        peer = filterpy.KalmanFilter(dim_x=n, dim_z=1)
        peer.P, peer.Q, peer.R = 1e6 * np.eye(n), 1e-6 * np.eye(n), np.array([[1e-4]])
        peer.F = np.eye(n)
        for phi, y in zip(rows, forces, strict=True):
            peer.predict()
            peer.update(y, H=phi[None, :])

    return update


def _statsmodels() -> Update:
    """Its recursive least squares runs over a whole batch; what counts is the share of one sample."""
    recursive_ls: Any = import_module("statsmodels.regression.recursive_ls")

    def update(rows: Array, forces: Array) -> None:
        model = recursive_ls.RecursiveLS(forces, rows)
        model.filter([])

    return update


def _ticks() -> None:
    """The whole predictor at 1 kHz and 300 ms: learning from a late force, a tick of the haptic loop."""
    rng = np.random.default_rng(1)
    count = 20_000
    t = np.arange(count) * _DT_S
    x = 4e-3 * (1 - np.cos(2 * pi * 0.4 * t)) + 1e-3 * np.sin(2 * pi * 1.7 * t)
    f = (
        60.0 * x
        + 1.5 * np.gradient(x, _DT_S)
        + 0.1 * np.sign(np.gradient(x))
        + 0.01 * rng.standard_normal(count)
    )
    v = np.gradient(x, _DT_S)
    evaluator = Evaluator()
    learner = Learner(evaluator)
    learning_us, tick_us = [], []
    for n in range(count):
        if n >= _DELAY_SAMPLES:
            start_s = time.perf_counter()
            learner.take(float(t[n - _DELAY_SAMPLES]), float(f[n - _DELAY_SAMPLES]))
            evaluator.snapshot = learner.publish()
            learning_us.append((time.perf_counter() - start_s) * 1e6)
        start_s = time.perf_counter()
        if n >= _DELAY_SAMPLES:
            evaluator.hear(float(t[n - _DELAY_SAMPLES]), float(f[n - _DELAY_SAMPLES]))
        evaluator.move(float(t[n]), float(x[n]), float(x[n]), float(v[n]))
        evaluator.predict()
        tick_us.append((time.perf_counter() - start_s) * 1e6)
    print("\nforefeel's predictor, 1 kHz, 300 ms (after a second of warm-up)")
    for what, us in (
        ("learning from a force, snapshot", learning_us[1000:]),
        ("tick of the haptic loop", tick_us[1000:]),
    ):
        p50, p99 = np.percentile(us, [50, 99])
        print(f"  {p50:8.2f} us p50  {p99:8.2f} us p99  {what}")


if __name__ == "__main__":
    main()
