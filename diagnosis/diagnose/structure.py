"""Whether what is left is noise: noise of a measuring chain is forgotten within a few hundredths of a second."""

import numpy as np

from common.error_size import Floats
from diagnosis.diagnose.regression import Fit, Regression

HORIZON_S = 0.04
_TAPS = 12
_SPREAD_S = 0.5


def foretold_share(regression: Regression, fit: Fit) -> float:
    """Share of the residual's variance that its own past, at least 40 ms old, tells on the held-out half.

    First-order noise with a corner of 5 Hz or more leaves at most exp(-4 pi 5 0.04) = 8 %.
    """
    residual = regression.residual(fit)
    parts = [_pairs(residual[piece], regression.signals.rows[piece], regression) for piece in regression.signals.piecewise(fine=False)]
    past, now = (np.concatenate(c) for c in zip(*parts, strict=True))
    if len(now) < 10 * _TAPS:
        return 0.0
    half = len(now) // 2
    shares = [_share(past[a], now[a], past[b], now[b]) for a, b in _halves(half, len(now))]
    return float(max(0.0, np.mean(shares)))


def _pairs(residual: Floats, rows: Floats, regression: Regression) -> tuple[Floats, Floats]:
    rate = regression.signals.coarse_rate_hz
    first = max(1, int(np.ceil(HORIZON_S * rate)))
    lags = np.unique(first + np.round(np.geomspace(1, max(2.0, _SPREAD_S * rate), _TAPS)).astype(np.int64) - 1)
    index = np.arange(int(lags[-1]), len(residual))
    if not len(index):
        return np.empty((0, len(lags))), np.empty(0)
    columns = residual[index[:, None] - lags]
    good = rows[index] & rows[index[:, None] - lags].all(axis=1)
    return columns[good], residual[index][good]


def _halves(half: int, count: int) -> list[tuple[slice, slice]]:
    return [(slice(0, half), slice(half, count)), (slice(half, count), slice(0, half))]


def _share(past: Floats, now: Floats, past_out: Floats, now_out: Floats) -> float:
    gram = past.T @ past
    gram[np.diag_indices_from(gram)] += 1e-3 * np.trace(gram) / len(gram) + 1e-300
    weights = np.linalg.solve(gram, past.T @ now)
    return 1.0 - float(np.sum((now_out - past_out @ weights) ** 2) / max(np.sum(now_out**2), 1e-300))
