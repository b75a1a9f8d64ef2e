"""Least squares on the samples: what friction laws explain of a force on held-out blocks."""

from collections.abc import Callable

import numpy as np
from scipy.signal import savgol_filter

from tests.hidden_effects.laboratory.forces import played
from tests.hidden_effects.laboratory.truth import Array

_BLOCKS = 12
_SMOOTH = 11  # samples
_BREAKAWAYS = (0.001, 0.002, 0.003, 0.005, 0.01, 0.02, 0.03)  # of the stroke
COLUMNS = ("linear", "stop", "depth x stop", "(1, depth) x stop")


def left_of(time_s: Array, x: Array, force_n: Array) -> float:
    """rms of what mass, damping, stiffness and bias leave."""
    columns = _linear(time_s, x)
    solved = np.linalg.lstsq(columns, force_n, rcond=None)[0]
    return float(np.sqrt(np.mean((force_n - columns @ solved) ** 2)))


def shares(time_s: Array, x: Array, force_n: Array, inserted_m: float) -> dict[str, float]:
    """Share of the force's variance explained on blocks that were not fitted, for each of COLUMNS.

    `inserted_m`: depth of the tip where x is zero. The breakaway of a stop is that of the best fit.
    """
    linear = _linear(time_s, x)
    depth = (x + inserted_m) / (np.ptp(x) + inserted_m)
    laws: tuple[Callable[[Array], list[Array]], ...] = (
        lambda z: [z],
        lambda z: [depth * z],
        lambda z: [z, depth * z],
    )
    stops = [stop(x, share * float(np.ptp(x))) for share in _BREAKAWAYS]
    best = [max(_explained(np.column_stack([linear, *law(z)]), force_n) for z in stops) for law in laws]
    return dict(zip(COLUMNS, [_explained(linear, force_n), *best], strict=True))


def stop(x: Array, breakaway_m: float) -> Array:
    """Elastoplastic element: rises with the way, and slips at -1 and 1."""
    return (x - played(x, 2.0 * breakaway_m)) / breakaway_m


def _linear(time_s: Array, x: Array) -> Array:
    step_s = float(np.median(np.diff(time_s)))
    v, a = (savgol_filter(x, _SMOOTH, 3, deriv=order, delta=step_s) for order in (1, 2))
    return np.column_stack([np.ones_like(x), *(column / np.std(column) for column in (x, v, a))])


def _explained(columns: Array, force_n: Array) -> float:
    block = np.arange(len(force_n)) * _BLOCKS // len(force_n) % 2
    left = np.empty_like(force_n)
    for held in (0, 1):
        fitted = np.linalg.lstsq(columns[block != held], force_n[block != held], rcond=None)[0]
        left[block == held] = force_n[block == held] - columns[block == held] @ fitted
    return float(1.0 - np.var(left) / np.var(force_n))
