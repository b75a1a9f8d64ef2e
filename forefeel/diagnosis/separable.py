"""Least squares in which few parameters are not linear: those are searched, the rest is solved for.

Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from forefeel.common.error_size import Floats

Columns = Callable[[Floats], Floats]
"""From the logarithms of the shapes to the columns, shape (n, linear parameters)."""

_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Separable:
    """Logarithms of the shapes, linear parameters, what is left, and the covariance of both, shapes first."""

    log_shape: Floats
    theta: Floats
    left: Floats
    covariance: Floats

    def doubts(self) -> Floats:
        """1.96 standard deviations of each, shapes first."""
        return np.asarray(1.96 * np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def separable(columns: Columns, target: Floats, starts: Iterable[Floats]) -> Separable:
    """Fits from the best of several starts; neighbouring errors that are alike count as one in covariance."""

    def left(log_shape: Floats) -> Floats:
        table = columns(log_shape)
        if not np.isfinite(table).all():
            return target - np.mean(target)
        return np.asarray(target - table @ np.linalg.lstsq(table, target, rcond=None)[0])

    start = min(starts, key=lambda at: float(np.sum(left(at) ** 2)))
    log_shape = least_squares(left, start, x_scale=0.1, max_nfev=200).x if len(start) else start
    table = columns(log_shape)
    theta = np.linalg.lstsq(table, target, rcond=None)[0]
    rest = np.asarray(target - table @ theta)
    steps = _STEP * np.eye(len(log_shape))
    slopes = [(columns(log_shape + step) - table) @ theta / _STEP for step in steps]
    design = np.column_stack([*slopes, table])
    size = np.maximum(np.sqrt(np.sum(design**2, axis=0)), 1e-300)
    inverse = np.linalg.pinv((design / size).T @ (design / size)) / np.outer(size, size)
    covariance = _alike(rest) * float(np.mean(rest**2)) * inverse
    return Separable(np.asarray(log_shape), np.asarray(theta), rest, np.asarray(covariance))


def _alike(left: Floats) -> float:
    """Number of neighbours that count as one error: the sum of the autocorrelation up to its first zero."""
    power = np.abs(np.fft.rfft(left, 2 * len(left))) ** 2
    correlation = np.fft.irfft(power)[: len(left)]
    until = int(np.argmax(correlation <= 0.0)) or len(left)
    return max(1.0, 2.0 * float(np.sum(correlation[:until])) / max(float(correlation[0]), 1e-300) - 1.0)
