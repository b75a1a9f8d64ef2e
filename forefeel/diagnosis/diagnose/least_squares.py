"""Least squares on columns and on their inner products."""

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from forefeel.common.error_size import Floats

_DEPENDENT = 1e-7
_DEPENDENT_NORMAL = 1e-6  # inner products hold half of the digits


def solve(design: Floats, target: Floats) -> tuple[Floats, float]:
    """(coefficients, residual sum of squares); of dependent columns the later ones get zero."""
    scale = np.sqrt(np.einsum("ij,ij->j", design, design))
    scale[scale == 0.0] = 1.0
    q, r = np.linalg.qr(design / scale)
    diagonal = np.abs(np.diag(r))
    free = diagonal > _DEPENDENT
    if not free.all():
        inner, rss = solve(design[:, free], target)
        coefficients = np.zeros(design.shape[1])
        coefficients[free] = inner
        return coefficients, rss
    along = q.T @ target
    rest = target - q @ along
    return np.linalg.solve(r, along) / scale, float(rest @ rest)


def solve_normal(gram: Floats, moment: Floats) -> tuple[Floats, float]:
    """(coefficients, explained sum of squares); of dependent columns the later ones get zero."""
    if not len(moment):
        return np.empty(0), 0.0
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = 1.0
    factor, stopped = dpotrf(gram / np.outer(scale, scale), lower=1)
    diagonal = np.diag(factor)[: stopped - 1] if stopped else np.diag(factor)
    if stopped or diagonal.min(initial=1.0) < _DEPENDENT_NORMAL:
        free = np.ones(len(moment), dtype=np.bool_)
        weak = np.flatnonzero(diagonal < _DEPENDENT_NORMAL)
        free[weak[0] if len(weak) else stopped - 1] = False
        inner, explained = solve_normal(gram[np.ix_(free, free)], moment[free])
        coefficients = np.zeros(len(moment))
        coefficients[free] = inner
        return coefficients, explained
    scaled = moment / scale
    coefficients, _ = dpotrs(factor, scaled, lower=1)
    return coefficients / scale, float(scaled @ coefficients)


def solve_passive(gram: Floats, moment: Floats, sense: float, first: int) -> tuple[Floats, float]:
    """As `solve_normal`; the `first` coefficients have the sense of the force or are zero."""
    free = np.ones(len(moment), dtype=np.bool_)
    for _ in range(1 + first):
        coefficients = np.zeros(len(moment))
        coefficients[free], explained = solve_normal(gram[np.ix_(free, free)], moment[free])
        negative = coefficients[:first] * sense < 0.0
        if not negative.any():
            break
        free[:first] &= ~negative
    return coefficients, explained
