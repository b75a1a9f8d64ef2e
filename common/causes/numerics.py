"""Numerics on whole recordings: intervals, loops in C, means over samples."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from forefeel.common.kernels.library import kernels

Array = NDArray[np.float64]


def intervals_s(t: Array) -> Array:
    """dt before each stamp, shape (n,); 0 before the first, where every effect is at rest."""
    return np.diff(t, prepend=t[:1])


def loop(name: str, *arguments: Array | float, outputs: int = 1) -> Array:
    """Runs a loop in C (common/kernels/loops.c) over arrays of n samples; shape (n,) or (outputs, n).

    Raises:
        ValueError: arrays of several lengths, beyond which C would read.
    """
    rows = [np.ascontiguousarray(u, np.float64) if isinstance(u, np.ndarray) else float(u) for u in arguments]
    n, *others = {u.shape for u in rows if isinstance(u, np.ndarray)}
    if others or len(n) != 1:
        raise ValueError(f"{name}: arrays of shapes {n, *others}, expected one length")
    y = np.empty((outputs, *n))
    addresses = [u.ctypes.data if isinstance(u, np.ndarray) else u for u in (*rows, *y)]
    getattr(kernels(), name)(*addresses, *n)
    return y if outputs > 1 else y[0]


def sign_means(v: Array, band: float) -> Array:
    """Mean of sign(v), linear within +-`band`, over each sample's interval."""

    def integral(u: Array) -> Array:
        size = np.abs(u)
        return np.where(size < band, 0.5 * u * u / band, size - 0.5 * band)

    return _means(v, integral, lambda u: np.clip(u / band, -1.0, 1.0))


def share_above(x: Array, limit: float) -> Array:
    """Share of each sample's interval in which x is above the limit."""
    return _means(x - limit, lambda u: np.maximum(u, 0.0), lambda u: np.asarray(u > 0.0, dtype=np.float64))


def _means(u: Array, integral: Callable[[Array], Array], value: Callable[[Array], Array]) -> Array:
    """Returns the mean of value(u) from half an interval before each sample to half an interval after it. u
    is linear in between, and `integral` is the antiderivative of `value`: the means are exact. Shape (n,).
    """
    between = 0.5 * (u[1:] + u[:-1])
    ends = np.concatenate([u[:1], between]), np.concatenate([between, u[-1:]])
    total, at = integral(u), value(u)
    halves = []
    for end in ends:
        step = end - u
        large = np.abs(step) > 1e-9 * (np.abs(u) + np.abs(end)) + 1e-300
        slope = (integral(end) - total) / np.where(large, step, 1.0)
        halves.append(np.where(large, slope, at))
    return np.asarray(0.5 * (halves[0] + halves[1]))
