"""Whitening of a first-order autoregressive noise with a white part: together an ARMA(1, 1)."""

from math import pi, sqrt

import numpy as np

from tests.hidden_effects.generator.scan import Array, one_pole
from tests.hidden_effects.generator.truth import Noise


def whitened(columns: Array, noise: Noise, rate_hz: float, more_white_n: float = 0.0) -> Array:
    """Filtered along axis 0 so that the noise becomes white of unit size; one sample shorter.

    `u = s + w`, `(1 - p B) u = (1 + q B) e`; e are the innovations (Brockwell and Davis, Time Series,
    chapter 3).
    """
    pole = float(np.exp(-2.0 * pi * noise.corner_hz / rate_hz))
    white = noise.white_n**2 + more_white_n**2
    variance = noise.rms_n**2 * (1.0 - pole * pole) + white * (1.0 + pole * pole)
    ratio = -pole * white / variance
    zero = 0.0 if ratio == 0.0 else (1.0 - sqrt(1.0 - 4.0 * ratio * ratio)) / (2.0 * ratio)
    size = sqrt(variance / (1.0 + zero * zero))
    change = (columns[1:] - pole * columns[:-1]) / size
    return one_pole(-zero, change)
