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

from typing import Annotated, Protocol

import numpy as np

from forefeel.common.kernels.record import Array

BINS, ZERO_BIN, PER_OCTAVE = 128, 64, 8
_FIRST_BIN, _FIRST_S = ZERO_BIN + PER_OCTAVE, 0.1
"""Initial score of 2, with the weight of 0.1 s of errors."""


class Band(Protocol):
    """Sums of weighted |e| and of the weights, time scored, s, the histogram in s."""

    errors: float
    weight: float
    seen_s: float
    shift: float
    scores: Annotated[Array, BINS]


def begin(band: np.void) -> None:
    """Initialises a record of zeros to expect errors of twice the scale."""
    band["scores"][_FIRST_BIN] = _FIRST_S
