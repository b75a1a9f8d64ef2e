"""Held-out blocks: what a model says about stretches that it was not fitted to, with block-bootstrap
intervals.

Neighbouring errors are not independent; whole blocks are held out and drawn (Kuensch, Annals of Statistics
17, 1989).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.error_size import Floats
from diagnosis.diagnose.regression import Fit, Regression

_BLOCKS = 16
_LEAST_S = 1.0
_DRAWS = 1000


@dataclass(frozen=True, slots=True)
class Gain:
    """rms before and after in N; `gain` = 1 - after / before with its 95 % interval."""

    before_n: float
    after_n: float
    gain: float
    low: float
    high: float


def block_numbers(regression: Regression) -> NDArray[np.int64]:
    """The block of each row that counts."""
    t = regression.signals.t[regression.rows]
    count = int(np.clip((t[-1] - t[0]) / _LEAST_S, 4, _BLOCKS))
    return np.asarray(np.minimum(((t - t[0]) / (t[-1] - t[0]) * count).astype(np.int64), count - 1))


def held_out_errors(regression: Regression, fit: Fit) -> Floats:
    """Error in N at the rows that count, each block predicted by the fit to all others, at the fit's
    shapes.
    """
    return held_out(regression, *columns(regression, fit))


def columns(regression: Regression, fit: Fit) -> tuple[Floats, Floats]:
    """(whitened, plain) columns of a model at the rows that count."""
    plain = [regression.block(fit.model, name, shape) for name, shape in [("", ()), *fit.model.items()]]
    return regression.design(fit.model)[0], np.hstack(plain)[regression.rows]


def held_out(regression: Regression, white: Floats, plain: Floats, ridge: Floats | float = 1e-10) -> Floats:
    """As `held_out_errors` for any columns, with a ridge on them in units of their own size."""
    scale = np.sqrt(np.mean(white**2, axis=0))
    scale[scale == 0.0] = 1.0
    white, plain = white / scale, plain / scale
    force, numbers = regression.signals.force[regression.rows], block_numbers(regression)
    gram, moment = white.T @ white, white.T @ regression.target
    errors = np.empty(len(force))
    for number in range(int(numbers[-1]) + 1):
        rows = numbers == number
        part = white[rows]
        inner = gram - part.T @ part
        inner[np.diag_indices_from(inner)] += ridge * len(white)
        theta = np.linalg.solve(inner, moment - part.T @ regression.target[rows])
        errors[rows] = force[rows] - plain[rows] @ theta
    return errors


def gain(regression: Regression, before: Floats, after: Floats) -> Gain:
    """Of two series of held-out errors."""
    numbers = block_numbers(regression)
    sums = np.array([[np.sum(e[numbers == k] ** 2) for e in (before, after)] for k in np.unique(numbers)])
    rng = np.random.default_rng(0)
    drawn = sums[rng.integers(len(sums), size=(_DRAWS, len(sums)))].sum(axis=1)
    ratios = 1.0 - np.sqrt(drawn[:, 1] / np.maximum(drawn[:, 0], 1e-300))
    low, high = np.quantile(ratios, (0.025, 0.975))
    rms = [float(np.sqrt(np.mean(e**2))) for e in (before, after)]
    return Gain(rms[0], rms[1], 1.0 - rms[1] / max(rms[0], 1e-300), float(low), float(high))
