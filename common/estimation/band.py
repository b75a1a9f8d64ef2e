"""The 95 % band: a scale that follows the errors, times a quantile of past errors over that scale.

    scale^2 = (mean |e| of the last 2 s)^2 + 2 (variance of the experts) + (d / 20)^2

with d the deviation from the hold. Each error adds its score |e| / scale to a histogram in eighths of an
octave, which fades with a time constant of a quarter of the time that has been scored, at most 20 s: errors
from before the predictor had learned fade soon. The factor is
the histogram's 95 % quantile times 2^s, and the shift s <- s + 0.1 w (miss - 0.05) after each force, so that
in the long run one in twenty misses, whatever the errors' distribution (Gibbs and Candes, Adaptive conformal
inference, NeurIPS 2021). The band is no wider than the largest error that the hold has made; before any
error it is as wide as the range of the forces.
"""

import math
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.jit import Array, kernel

_MISSES = 0.05
_MEMORY_S = 2.0
_SCORES_MEMORY_S = 20.0
_SCORES_SHARE = 0.25
_LEAST_MEMORY_S = 0.2
_SHIFT_RATE = 0.1
_SHIFT_LIMIT = 2.0
_OF_SPREAD = 2.0
_OF_DEVIATION = 0.05
_OF_RANGE = 1e-3
"""The scale is at least this part of the forces' range: the best resolution of a sensor."""

_BINS, _ZERO_BIN, _PER_OCTAVE = 128, 64, 8.0
_FIRST_BIN, _FIRST_S = 72, 0.1
"""Initial score of 2, with the weight of 0.1 s of errors."""


class Band(Protocol):
    """Sums of weighted |e| and of the weights, time scored, s, the histogram in s."""

    errors: float
    weight: float
    seen_s: float
    shift: float
    scores: Annotated[Array, _BINS]


def begin(band: NDArray[np.void]) -> None:
    """Initialises a record of zeros to expect errors of twice the scale."""
    band["scores"][:, _FIRST_BIN] = _FIRST_S


@kernel
def learn(band: Band, error_n: float, half_n: float, scale_n: float, w: float) -> None:
    """Updates the statistics of the 95 % band by the error of a prediction; `w`: the time in s it stands for.

    A miss, |error_n| > half_n, widens by `shift`, a hit narrows. |error_n| / scale_n enters the histogram
    `scores`, and |error_n| the recent mean; the past of these two fades within 20 s and 2 s, faster at first.
    """
    size_n = abs(error_n)
    miss = 1.0 if size_n > half_n else 0.0
    band.shift = min(_SHIFT_LIMIT, max(-_SHIFT_LIMIT, band.shift + _SHIFT_RATE * w * (miss - _MISSES)))
    band.seen_s += w
    memory_s = max(_LEAST_MEMORY_S, _SCORES_SHARE * band.seen_s)
    band.scores *= math.exp(-w / min(_SCORES_MEMORY_S, memory_s))
    place = _PER_OCTAVE * math.log2(size_n / scale_n + 1e-12) + _ZERO_BIN
    place = min(_BINS - 1.001, max(0.0, place))
    low = int(place)
    band.scores[low] += w * (1.0 - place + low)
    band.scores[low + 1] += w * (place - low)
    keep = math.exp(-w / min(_MEMORY_S, memory_s))
    band.errors = band.errors * keep + w * size_n
    band.weight = band.weight * keep + w


@kernel
def recent_n(band: Band) -> float:
    """Mean |e| of the last 2 s in N."""
    return band.errors / (band.weight + 1e-9)


@kernel
def factor(band: Band) -> float:
    """Half the width of the band over its scale; infinite before any error."""
    return math.pow(2.0, _quantile(band.scores) + band.shift) if band.seen_s > 0.0 else math.inf


@kernel
def scale_n(recent_n: float, spread_n2: float, deviation_n: float, range_n: float) -> float:
    """Expected size of errors now, in N; `spread_n2`: variance of the experts, `range_n`: of the forces."""
    variance_n2 = recent_n * recent_n + _OF_SPREAD * spread_n2 + (_OF_DEVIATION * deviation_n) ** 2
    return math.sqrt(variance_n2) + _OF_RANGE * range_n + 1e-200


@kernel
def _quantile(scores: Array) -> float:
    """Returns log2 of the score |e| / scale that 5 % of the weight in a histogram exceeds, interpolated.

    `scores`: weight in s by bins of an eighth of an octave; bin 64 is a score of 1.
    """
    beyond: float = _MISSES * scores.sum()
    b = _BINS - 1
    while b > 0 and beyond > scores[b]:
        beyond -= scores[b]
        b -= 1
    part = 0.5 - beyond / (float(scores[b]) + 1e-200)
    return (b + part - _ZERO_BIN) / _PER_OCTAVE
