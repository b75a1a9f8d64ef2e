"""Errors of a model in blocks that it was not fitted to, and gains with block-bootstrap intervals.

Neighbouring errors are not independent; whole blocks are held out and drawn (Kuensch, Annals of Statistics
17, 1989).
"""

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import Floats
from forefeel.diagnosis.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.verdict import HeldOut

_BLOCKS = 16
_LEAST_S = 1.0
_DRAWS = 1000
_SEEN = 0.2


def block_numbers(regression: RecordingRegression) -> NDArray[np.int64]:
    """Block number of each row that counts: its recording of several, else one of 4 to 16 of equal size."""
    t = regression.signals.t[regression.rows]
    if regression.parts_s:
        return np.asarray(np.searchsorted(regression.parts_s, t))
    count = int(np.clip(len(t) / regression.signals.coarse_rate_hz / _LEAST_S, 4, _BLOCKS))
    starts = np.linspace(0, len(t), count + 1).astype(np.int64)[1:-1]
    return np.asarray(np.searchsorted(t[starts], t, side="right"))


def held_out_errors(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Errors in N at the rows that count, each block predicted by coefficients fitted to all others; shapes
    stay, and coefficients that are 0 in the fit are 0 there, too.
    """
    white, plain = columns(regression, fit)
    acts = fit.coefficients != 0.0
    return held_out(regression, white[:, acts], plain[:, acts])


def columns(regression: RecordingRegression, fit: ModelFit) -> tuple[Floats, Floats]:
    """(whitened, plain) columns of a model at the rows that count."""
    return regression.design(fit.model), plain_columns(regression, fit)[regression.rows]


def plain_columns(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Columns of a model in N on the coarse grid, not whitened."""
    model = fit.model
    return np.hstack([regression.block(model, name, shape) for name, shape in [("", ()), *model.items()]])


def held_out(
    regression: RecordingRegression, white: Floats, plain: Floats, ridge: Floats | float = 1e-10
) -> Floats:
    """Held-out errors in N for any columns, with a ridge on them in units of their own size."""
    scale = np.sqrt(np.mean(white**2, axis=0))
    scale[scale == 0.0] = 1.0
    white = white / scale
    numbers = block_numbers(regression)
    gram, moment = white.T @ white, white.T @ regression.target
    full = np.linalg.solve(gram + np.diag(np.full(len(gram), 1.0) * ridge) * len(white), moment)
    thetas = np.tile(full, (int(numbers[-1]) + 1, 1))
    for number, theta in enumerate(thetas):
        rows = numbers == number
        part = white[rows]
        inner = gram - part.T @ part
        # what shows in this block only, such as a decay from the start, can not be learned elsewhere
        known = np.diag(inner) > _SEEN * np.diag(gram)
        inner[np.diag_indices_from(inner)] += ridge * len(white)
        right = moment - part.T @ regression.target[rows] - inner[:, ~known] @ full[~known]
        theta[known] = np.linalg.solve(inner[np.ix_(known, known)], right[known])
    force, theta = regression.signals.force[regression.rows], thetas / scale
    return np.asarray(force - np.einsum("ij,ij->i", plain, theta[numbers]))


def gain(regression: RecordingRegression, before: Floats, after: Floats) -> HeldOut:
    """Gain from one series of held-out errors to another, both at the rows that count."""
    return gain_over(block_numbers(regression), before, after)


def gain_over(numbers: NDArray[np.int64], before: Floats, after: Floats) -> HeldOut:
    """Gain from one series of errors to another, its interval by bootstrap; `numbers`: their blocks."""
    sums = np.array([[np.sum(e[numbers == k] ** 2) for e in (before, after)] for k in np.unique(numbers)])
    rng = np.random.default_rng(0)
    drawn = sums[rng.integers(len(sums), size=(_DRAWS, len(sums)))].sum(axis=1)
    ratios = 1.0 - np.sqrt(drawn[:, 1] / np.maximum(drawn[:, 0], 1e-300))
    low, high = np.quantile(ratios, (0.025, 0.975))
    rms = [float(np.sqrt(np.mean(e**2))) for e in (before, after)]
    return HeldOut(rms[0], rms[1], 1.0 - rms[1] / max(rms[0], 1e-300), float(low), float(high))
