"""A peer: PySINDy's STLSQ over the same candidate columns where it has them.

Columns are scaled to unit std, the threshold is selected by blocked cross-validation (fewest terms within one
standard error of the best).
"""

import time
import warnings

import numpy as np
from numpy.typing import NDArray
from pysindy import STLSQ

from forefeel.common.error_size import Floats
from tests.hidden_effects.answers import Answer, Measured
from tests.hidden_effects.columns import answer, candidates, moves

_BLOCKS = 5
_THRESHOLDS = (0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.25, 0.4)
"""Of the std of the force."""


def sparse(measured: Measured) -> Answer:
    start_s = time.perf_counter()
    if not moves(measured):
        return Answer("refused", seconds=time.perf_counter() - start_s)
    phi, force = candidates(measured)
    scale = np.std(phi, axis=0)
    scale[scale < 1e-12] = 1.0
    unit = float(np.std(force))
    coefficients = selected(phi / scale, force / unit) * unit
    return answer(coefficients, coefficients / scale, time.perf_counter() - start_s)


def _fitted(phi: Floats, force: Floats, threshold: float) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = STLSQ(threshold=threshold, alpha=1e-6, max_iter=30).fit(phi, force[:, None])
    return np.asarray(found.coef_[0], dtype=np.float64)


def selected(phi: Floats, force: Floats) -> Floats:
    """Coefficients at the threshold of the sparsest model within one standard error of the best."""
    blocks = np.array_split(np.arange(len(force)), _BLOCKS)
    errors = np.array([[_error(phi, force, held, limit) for held in blocks] for limit in _THRESHOLDS])
    mean = np.mean(errors, axis=1)
    best = int(np.argmin(mean))
    allowed = mean[best] + float(np.std(errors[best])) / np.sqrt(_BLOCKS)
    last = max(n for n, error in enumerate(mean) if error <= allowed)
    return _fitted(phi, force, _THRESHOLDS[last])


def _error(phi: Floats, force: Floats, held: NDArray[np.int_], limit: float) -> float:
    seen = np.ones(len(force), dtype=bool)
    seen[held] = False
    rest = force[held] - phi[held] @ _fitted(phi[seen], force[seen], limit)
    return float(np.mean(rest * rest))
