"""Recursions over a whole record without a loop over samples: by doubling, ceil(log2 n) passes of numpy.

A recursion `y_n = F_n(y_{n-1})` whose maps compose into maps of the same family is solved by composing
neighbours, then neighbours of neighbours (Hillis and Steele, Data Parallel Algorithms, CACM 29(12), 1986).
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Signal = TypeVar("Signal", Array, NDArray[np.complex128])

_VANISHED = 1e-17


def one_pole(pole: complex, drive: Signal) -> Signal:
    """`y_n = pole y_{n-1} + drive_n` from rest; a complex pole needs a complex drive."""
    power: Any = pole
    y, shift = drive.copy(), 1
    while shift < len(y) and abs(power) > _VANISHED:
        y[shift:] += power * y[:-shift]
        power, shift = power * power, 2 * shift
    return y


def varying_pole(decay: Array, drive: Array) -> Array:
    """`y_n = decay_n y_{n-1} + drive_n` from rest."""
    y, gain, shift = drive.copy(), decay.copy(), 1
    while shift < len(y):
        y[shift:] += gain[shift:] * y[:-shift]
        gain[shift:] *= gain[:-shift].copy()
        shift *= 2
    return y


def play(x: Array, width: float) -> Array:
    """`y_n = clip(y_{n-1}, x_n - width / 2, x_n + width / 2)` from the middle of the gap."""
    low, high, shift = x - 0.5 * width, x + 0.5 * width, 1
    while shift < len(x):
        below, above = low[:-shift].copy(), high[:-shift].copy()
        low_now, high_now = low[shift:].copy(), high[shift:].copy()
        low[shift:] = np.clip(below, low_now, high_now)
        high[shift:] = np.clip(above, low_now, high_now)
        shift *= 2
    return np.clip(np.full_like(x, x[0]), low, high)
