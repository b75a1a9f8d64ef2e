"""The 95 % band: size of recent errors, disagreement of the experts, a factor that is learned from hits.

half width = 2 e^q sigma with sigma^2 = (mean |e| of the last 2 s)^2 + variance of the experts + (0.1 d)^2, d
the deviation from the hold. After each force q <- q + 3 w (miss - 0.05): in the long run one in twenty
misses, whatever the errors' distribution (Gibbs and Candes, Adaptive conformal inference, NeurIPS 2021). The
band is no wider than the largest error that the hold has made.
"""

import math
from typing import Protocol

from common.estimation.jit import kernel
from common.estimation.record import record

_MEMORY_S = 2.0
_MISSES = 0.05
_RATE = 3.0
_OF_DEVIATION = 0.1
_LOG_LIMITS = (-3.0, 4.0)

DTYPE = record("log_factor errors weight")


class Band(Protocol):
    """A record of `DTYPE`: q, the sum of weighted |e|, the sum of the weights."""

    log_factor: float
    errors: float
    weight: float


@kernel
def learn(band: Band, error_n: float, half_n: float, widest_n: float, w: float) -> None:
    """The error of a prediction whose half width was `half_n`; `widest_n`: the limit at that time."""
    miss = abs(error_n) > half_n
    if not miss or half_n < 0.999 * widest_n:
        factor = band.log_factor + _RATE * w * ((1.0 if miss else 0.0) - _MISSES)
        band.log_factor = min(_LOG_LIMITS[1], max(_LOG_LIMITS[0], factor))
    keep = math.exp(-w / _MEMORY_S)
    band.errors = band.errors * keep + w * abs(error_n)
    band.weight = band.weight * keep + w


@kernel
def half_width_n(band: Band, spread_n2: float, deviation_n: float, widest_n: float, range_n: float) -> float:
    """Half the width of the band in N; `widest_n` 0: no limit yet."""
    recent_n = band.errors / (band.weight + 1e-9)
    variance_n2 = recent_n * recent_n + spread_n2 + (_OF_DEVIATION * deviation_n) ** 2
    half_n = 2.0 * math.exp(band.log_factor) * (math.sqrt(variance_n2) + 1e-3 * range_n + 1e-12)
    return min(half_n, widest_n) if widest_n > 0.0 else half_n
