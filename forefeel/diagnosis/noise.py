"""The noise that no model explains: an autoregression, whitening with it, the floor in N."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from forefeel.common.error_size import Floats
from forefeel.diagnosis.signals import Mask

_RIDGE = 1e-4
_ORDER = 12
LEAST_CORNER_HZ = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """`e(i) = sum_j taps(j) r(i - j)`, taps(0) = 1, is white with standard deviation `innovation_n`."""

    taps: Floats
    innovation_n: float

    def whiten(self, columns: Floats, pieces: Sequence[slice]) -> Floats:
        """Each column (axis 0 is time) through the whitening filter, started anew in every piece."""
        return np.concatenate([lfilter(self.taps, 1.0, columns[piece], axis=0) for piece in pieces])

    def response(self, phase: Floats) -> NDArray[np.complex128]:
        """What whitening does to a spectrum, over innovation; `phase` in rad per sample, any shape."""
        lags = np.arange(len(self.taps))
        return np.asarray(np.exp(-1j * phase[..., None] * lags) @ self.taps / self.innovation_n)

    def rows(self, rows: Mask, pieces: Sequence[slice]) -> Mask:
        """Those rows whose whitened value rests on counting rows only."""
        return _whole(rows, pieces, len(self.taps))


def white() -> Noise:
    return Noise(np.array([1.0, 0.0]), 1.0)


def autoregression(
    residual: Floats, rows: Mask, pieces: Sequence[slice], rate_hz: float, corner_hz: float = LEAST_CORNER_HZ
) -> Noise:
    """Yule-Walker on what counts, rows that do not count taken as zero (Parzen's amplitude-modulated series).

    A small ridge keeps the filter's stop-band from being blown up. What is remembered for longer than noise
    with that corner is structure: taken for noise it would blind the search for slow causes.
    """
    counted = float(np.count_nonzero(rows))
    order = _order(rows, pieces)
    mean = float(np.mean(residual[rows]))
    gamma = np.zeros(order + 1)
    pairs = np.zeros(order + 1)
    for piece in pieces:
        r, w = np.where(rows[piece], residual[piece] - mean, 0.0), rows[piece].astype(np.float64)
        for lag in range(min(order + 1, len(r))):
            gamma[lag] += r[lag:] @ r[: len(r) - lag]
            pairs[lag] += w[lag:] @ w[: len(w) - lag]
    gamma /= np.maximum(pairs, 1.0)
    longest = np.exp(-2.0 * np.pi * corner_hz / rate_hz * np.arange(order + 1))
    gamma = np.clip(gamma, -gamma[0] * longest, gamma[0] * longest)
    gamma *= 1.0 - np.arange(order + 1) / max(counted, order + 2.0)
    if gamma[0] <= 0.0 or order < 2:
        return white()
    gamma[0] *= 1.0 + _RIDGE
    phi = solve_toeplitz(gamma[:-1], gamma[1:])
    variance = gamma[0] - float(phi @ gamma[1:])
    if variance <= 0.0:  # clipping left no autocovariance: first order, then
        phi, variance = gamma[1:2] / gamma[0], gamma[0] - gamma[1] ** 2 / gamma[0]
    return Noise(np.concatenate([[1.0], -phi]), float(np.sqrt(max(variance, 1e-300))))


def _order(rows: Mask, pieces: Sequence[slice]) -> int:
    """As high as leaves half of the rows: whitening costs as many behind each one that does not count."""
    counted = int(np.count_nonzero(rows))
    order = min(_ORDER, counted // 20)
    while order > 1 and 2 * np.count_nonzero(_whole(rows, pieces, order + 1)) < counted:
        order //= 2
    return order


def _whole(rows: Mask, pieces: Sequence[slice], reach: int) -> Mask:
    """Those rows that are the last of `reach` counting ones in a row of one piece."""
    good: list[Mask] = []
    for piece in pieces:
        count = np.concatenate([np.zeros(reach), np.cumsum(rows[piece])])
        good.append(np.asarray(count[reach:] - count[:-reach] == reach))
    return np.concatenate(good)
