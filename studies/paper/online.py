"""Learning across a delay: what a predictor can know at each instant, by the paper's algorithm and by ours.

At time t the forces stamped <= t - delay have arrived; without a delay, those before t. The prediction for t
is phi(t)' theta with what those have taught. So every prediction is a priori.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.paper import PaperRls
from forefeel.common.estimation.rls import RecursiveLeastSquares
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.studies.paper.contact import Array

PAPER_LAMBDA = 0.96  # forgetting factor of a sample; one of the 0.95 to 0.99 that the paper recommends
PAPER_DELTA = 1e-6
"""P(0) = I / delta (8), "very small": the paper gives no number."""

SAFE_MEMORY_S = 2.0
"""Time constant of forgetting of the product's estimator."""

Pairing = Literal["stamps", "newest"]
"""With which motion a late force is paired: that of its own stamp, or the newest ("ignores the time lag")."""

_ROUNDING_S = 1e-6  # s, rounding of stamps, so that a force counts as arrived exactly after the delay


@dataclass(frozen=True, slots=True)
class Learned:
    """One pass over n samples.

    Attributes:
        predicted_n: shape (n,); NaN before the first force arrived and after an overflow.
        theta: parameters after what had arrived, shape (n, p); NaN after an overflow.
        overflow_s: time at which the algorithm's numbers were no longer finite, or None.
    """

    predicted_n: Array
    theta: Array
    overflow_s: float | None


def newest_index(time_s: Array, delay_s: float) -> NDArray[np.int64]:
    """For each stamp the index of the newest force that has arrived, -1 for none; shape (n,)."""
    if delay_s <= 0.0:
        return np.arange(len(time_s), dtype=np.int64) - 1
    arrived = np.searchsorted(time_s, time_s - delay_s + _ROUNDING_S, side="right")
    return np.asarray(arrived - 1, dtype=np.int64)


def held(time_s: Array, force_n: Array, delay_s: float) -> Array:
    """The newest force that has arrived, NaN before the first: the baseline; shape (n,)."""
    newest = newest_index(time_s, delay_s)
    return np.where(newest >= 0, force_n[np.maximum(newest, 0)], np.nan)


def learn_paper(
    time_s: Array,
    rows: Array,
    force_n: Array,
    delay_s: float,
    *,
    lam: float = PAPER_LAMBDA,
    pairing: Pairing = "stamps",
    symmetrise: bool = True,
) -> Learned:
    """The paper's algorithm, (8) to (12), on phi = `rows` of shape (n, p).

    `symmetrise`: see `PaperRls`; on by default, since without it rounding alone ends long runs early.
    """
    rls = PaperRls(rows.shape[1], lam, delta=PAPER_DELTA, symmetrise=symmetrise)

    def update(phi: Array, y: float, dt: float) -> Array:
        del dt
        rls.update(phi, y)
        return rls.theta

    return _learn(time_s, rows, force_n, delay_s, pairing, update)


def safe_rls(rows: Array, memory_s: float = SAFE_MEMORY_S) -> RecursiveLeastSquares:
    """The product's recursive least squares for [m, b, k, ...]: scales the rms of each regressor, none of m,
    b, k below 0.
    """
    scales = np.sqrt(np.mean(rows**2, axis=0)).tolist()
    bounds = [(0.0, math.inf)] * 3 + [(-math.inf, math.inf)] * (len(scales) - 3)
    return RecursiveLeastSquares(scales, memory_s, bounds=bounds[: len(scales)])


def learn_safe(
    time_s: Array, rows: Array, force_n: Array, delay_s: float
) -> tuple[Learned, RecursiveLeastSquares]:
    """The product's recursive least squares on the same: gated, bounded, forgetting in seconds."""
    rls = safe_rls(rows)

    def update(phi: Array, y: float, dt: float) -> Array:
        rls.update(phi.tolist(), y, dt)
        return np.array(rls.parameters)

    return _learn(time_s, rows, force_n, delay_s, "stamps", update), rls


def _learn(
    time_s: Array,
    rows: Array,
    force_n: Array,
    delay_s: float,
    pairing: Pairing,
    update: Callable[[Array, float, float], Array],
) -> Learned:
    newest = newest_index(time_s, delay_s).tolist()
    late = pairing == "newest" and delay_s > 0.0
    predicted = np.full(len(time_s), np.nan)
    theta = np.full((len(time_s), rows.shape[1]), np.nan)
    now, next_force = np.zeros(rows.shape[1]), 0
    steps = np.minimum(np.diff(time_s, prepend=time_s[0]), GAP_S).tolist()
    with np.errstate(over="ignore", invalid="ignore"):
        for i, available in enumerate(newest):
            for j in range(next_force, available + 1):
                now = update(rows[i if late else j], force_n[j], steps[j])
            next_force = max(next_force, available + 1)
            if not np.isfinite(now).all():
                return Learned(predicted, theta, float(time_s[i] - time_s[0]))
            theta[i] = now
            if available >= 0:
                predicted[i] = rows[i] @ now
    return Learned(predicted, theta, None)
