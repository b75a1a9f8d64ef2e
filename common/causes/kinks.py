"""Jumps at samples: means over each sample's interval instead of values at instants.

A sign or a contact that changes between two samples would be late by up to one of them; its mean over the
interval, the signal being a straight line between samples, is not (antiderivative antialiasing: Parker,
Zavalishin and Le Bivic, DAFx 2016).
"""

from collections.abc import Callable

import numpy as np

from forefeel.common.causes.offline import Array as Floats


def direction(v: Floats, band: float) -> Floats:
    """Mean of sign(v), linear within +-`band`, over each sample's interval."""

    def integral(u: Floats) -> Floats:
        size = np.abs(u)
        return np.where(size < band, 0.5 * u * u / band, size - 0.5 * band)

    return _means(v, integral, lambda u: np.clip(u / band, -1.0, 1.0))


def beyond(x: Floats, limit: float) -> Floats:
    """Share of each sample's interval in which x is above the limit."""
    return _means(x - limit, lambda u: np.maximum(u, 0.0), lambda u: np.asarray(u > 0.0, dtype=np.float64))


def _means(u: Floats, integral: Callable[[Floats], Floats], value: Callable[[Floats], Floats]) -> Floats:
    """Over half an interval to each side, by differences of the integral."""
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
