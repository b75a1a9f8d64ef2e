"""Time offset of an estimate of a force, apart from the error of its value. Pure.

A force that is right but 20 ms late, and one in time but 5 % off, may have the same rms error, and feel
different. So both are stated, as in ETVO (arXiv 2107.05343). ETVO warps time, sample by sample; here the
offset is one number for the whole trace: the shift at which the estimate correlates best with the force.
"""

from math import sqrt

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.estimation.state_filter import GAP_S

LONGEST_OFFSET_S = 1.0
_STEP_S = 0.005  # between two shifts that are tried; what lies between them is read off a parabola


def time_offset_s(time_s: Floats, estimate_n: Floats, force_n: Floats) -> float | None:
    """Shift of the estimate against the force in s, above 0 where the estimate is late. Rows with a NaN, and
    gaps over 0.1 s, take no part. None where either does not vary, or the best shift is 1 s, the longest one.

    Args:
        time_s: stamps in any order, shape (n,); estimate_n and force_n have the same shape.
    """
    if len(time_s) < 2:
        return None
    order = np.argsort(time_s, kind="stable")
    time_s, estimate_n, force_n = time_s[order], estimate_n[order], force_n[order]
    # no shift reaches over a pause of twice the longest; what is beyond that would only take memory
    time_s = time_s - np.cumsum((np.diff(time_s, prepend=time_s[0]) - 2 * LONGEST_OFFSET_S).clip(0.0))
    grid_s = np.arange(time_s[0], time_s[-1], _STEP_S)
    # rounding may take the last place of the grid past the end
    after = np.searchsorted(time_s, grid_s).clip(1, len(time_s) - 1)
    apart = time_s[after] - time_s[after - 1] > GAP_S
    late, true = (np.where(apart, np.nan, np.interp(grid_s, time_s, of)) for of in (estimate_n, force_n))
    n, most = len(grid_s), min(round(LONGEST_OFFSET_S / _STEP_S), len(grid_s) // 2)
    fits = np.array([
        _correlation(late[max(k, 0) : n + min(k, 0)], true[max(-k, 0) : n - max(k, 0)])
        for k in range(-most, most + 1)
    ])  # fmt: skip
    best = int(np.argmax(fits))
    if not np.isfinite(fits[best]) or not 0 < best < len(fits) - 1:
        return None
    before, top, behind = fits[best - 1 : best + 2].tolist()
    bend = before - 2.0 * top + behind
    between = 0.5 * (before - behind) / bend if np.isfinite(bend) and bend < 0.0 else 0.0
    return float(_STEP_S * (best - most + between))


def _correlation(first: Floats, second: Floats) -> float:
    """Pearson's, over the rows finite in both; -inf for fewer than 3, or where one is constant."""
    both = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(both) < 3:
        return -np.inf
    a, b = (of[both] - np.mean(of[both]) for of in (first, second))
    spread = sqrt(float(a @ a)) * sqrt(float(b @ b))
    return float(a @ b) / spread if spread > 0.0 else -np.inf
