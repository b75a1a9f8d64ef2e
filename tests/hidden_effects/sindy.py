"""The peer: PySINDy's STLSQ over the same candidate columns where it has them.

Columns are scaled to unit std, motion and force go through one Savitzky-Golay filter, the threshold is chosen
by blocked cross-validation (fewest terms within one standard error of the best). What it can not say
(`unexplained`, `not_separable`, effects with memory) it is not asked to say by other means.
"""

import time
import warnings

import numpy as np
from pysindy import STLSQ
from scipy.signal import savgol_filter

from tests.hidden_effects.answers import Answer, Interval
from tests.hidden_effects.generator import Hidden
from tests.hidden_effects.generator.scan import Array

_COLUMNS = (
    ("", "mass_kg"), ("", "damping_n_s_m"), ("", "stiffness_n_m"),
    ("bias", "force_n"), ("coulomb_friction", "force_n"), ("quadratic_drag", "drag_n_s2_m2"),
    ("stiffening", "quadratic_n_m2"), ("stiffening", "cubic_n_m3"),
    ("hunt_crossley_damping", "damping_n_s_m2"), ("asymmetric_damping", "half_difference_n_s_m"),
    ("position_dependent_friction", "force_per_length_n_m"), ("sensor_drift", "rate_n_s"),
)  # fmt: skip
KNOWN = frozenset(name for name, _ in _COLUMNS if name)
_WINDOW_S, _BLOCKS = 0.06, 5
_THRESHOLDS = (0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.25, 0.4)
"""Of the std of the force."""


def sparse(hidden: Hidden) -> Answer:
    """Its answer: every column that keeps a coefficient names its effect; mass, damping, stiffness none."""
    start_s = time.perf_counter()
    phi, force = _candidates(hidden)
    scale = np.std(phi, axis=0)
    scale[scale < 1e-12] = 1.0
    unit = float(np.std(force))
    if unit == 0.0 or np.ptp(hidden.position_m) < 1e-5:
        return Answer("refused", seconds=time.perf_counter() - start_s)
    coefficients = _chosen(phi / scale, force / unit) * unit
    return _answer(coefficients, coefficients / scale, time.perf_counter() - start_s)


def _candidates(hidden: Hidden) -> tuple[Array, Array]:
    """Columns in the order of _COLUMNS and the force, filtered alike on an even grid."""
    rate_hz = 1.0 / float(np.median(np.diff(hidden.time_s)))
    t = np.arange(hidden.time_s[0], hidden.time_s[-1], 1.0 / rate_hz)
    window = max(5, 2 * int(0.5 * _WINDOW_S * rate_hz) + 1)
    position = np.interp(t, hidden.time_s, hidden.position_m)
    x, v, a = (savgol_filter(position, window, 3, order, 1.0 / rate_hz) for order in (0, 1, 2))
    force = savgol_filter(np.interp(t, hidden.time_s, hidden.force_n), window, 3)
    inside, sense = np.maximum(x, 0.0), np.sign(v) * (np.abs(v) > 1e-4)
    columns = (a, v, x, np.ones_like(x), sense, v * np.abs(v), x**2, x**3)
    more = (inside * v, np.abs(v), inside * sense, t - t[0])
    return np.stack([*columns, *more], axis=1), force


def _fitted(phi: Array, force: Array, threshold: float) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = STLSQ(threshold=threshold, alpha=1e-6, max_iter=30).fit(phi, force[:, None])
    return np.asarray(found.coef_[0], dtype=np.float64)


def _chosen(phi: Array, force: Array) -> Array:
    """Coefficients at the threshold of the sparsest model within one standard error of the best."""
    blocks = np.array_split(np.arange(len(force)), _BLOCKS)
    errors = np.array([[_error(phi, force, held, limit) for held in blocks] for limit in _THRESHOLDS])
    mean = np.mean(errors, axis=1)
    best = int(np.argmin(mean))
    allowed = mean[best] + float(np.std(errors[best])) / np.sqrt(_BLOCKS)
    last = max(n for n, error in enumerate(mean) if error <= allowed)
    return _fitted(phi, force, _THRESHOLDS[last])


def _error(phi: Array, force: Array, held: np.ndarray[tuple[int], np.dtype[np.int_]], limit: float) -> float:
    seen = np.ones(len(force), dtype=bool)
    seen[held] = False
    rest = force[held] - phi[held] @ _fitted(phi[seen], force[seen], limit)
    return float(np.mean(rest * rest))


def _answer(sizes_n: Array, values: Array, seconds: float) -> Answer:
    explained: dict[str, float] = {}
    parameters: dict[str, dict[str, Interval]] = {}
    for (name, parameter), size_n, value in zip(_COLUMNS, sizes_n, values, strict=True):
        if name and size_n != 0.0:
            explained[name] = explained.get(name, 0.0) + abs(float(size_n))
            factor = 2.0 if parameter.startswith("half_") else 1.0
            found = factor * float(value)
            parameters.setdefault(name, {})[parameter.removeprefix("half_")] = (found, found, found)
    names = tuple(sorted(explained, key=lambda name: -explained[name]))
    return Answer("cause_found" if names else "nothing_missing", names, parameters, seconds=seconds)
