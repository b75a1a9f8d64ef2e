"""The paper's own algorithm, equations (8) to (12), as it stands there: the reference that everything else is
measured against. Not for daemons: it has none of the safeguards of `forefeel.common.estimation.rls`.

Reference: "Study on Contact Force Prediction for the Vascular Interventional Surgical Robot based on
Parameter Identification".
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PaperRls:
    """Recursive least squares with a forgetting factor, (8) to (12).

    Args:
        n: number of parameters.
        lam: forgetting factor lambda; 1 is ordinary recursive least squares, the paper recommends 0.95-0.99.
        delta: P(0) = I / delta (8), "very small".
        symmetrise: replace P by (P + P') / 2 after each update. The paper does not; without it rounding ends
            many long runs early.

    Attributes:
        theta: parameters, shape (n,). covariance: P, shape (n, n).
    """

    def __init__(self, n: int, lam: float, *, delta: float = 1e-6, symmetrise: bool = False) -> None:
        self.theta: Array = np.zeros(n)
        self.covariance: Array = np.eye(n) / delta
        self._lam = lam
        self._symmetrise = symmetrise

    def update(self, phi: Sequence[float] | Array, y: float) -> float:
        """One sample; returns the innovation e(k) (11). Overflow shows as infinity or NaN in `theta`."""
        phi = np.asarray(phi, dtype=np.float64)
        with np.errstate(over="ignore", invalid="ignore"):
            p_phi = self.covariance @ phi
            gain = p_phi / (self._lam + phi @ p_phi)  # (9)
            e = float(y - phi @ self.theta)  # (11)
            self.theta = self.theta + gain * e  # (12)
            p = (self.covariance - np.outer(gain, phi @ self.covariance)) / self._lam  # (10)
            self.covariance = 0.5 * (p + p.T) if self._symmetrise else p
        return e
