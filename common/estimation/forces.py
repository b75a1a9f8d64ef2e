"""Rejection of outliers: a force is accepted if it is near the range of the forces so far.

The range begins with the median of the first three. A force that is beyond it by more than its width is
suspect, until the next one confirms it; then both count. So a single force far out, of whatever size, is
never held, and a wall that is really there costs one sample.
"""

from typing import Annotated, Protocol

import numpy as np

from forefeel.common.kernels.record import Array

FIRST = 3
"""Number of forces that give a median; nothing is learned before."""


class Forces(Protocol):
    """known: number of forces. low_n, high_n: their range. first_n: f0, the median of the first three.
    before_n: the last force. suspect_s, suspect_n: the last one if not accepted, else NaN. admitted: (stamp,
    force) of those that `admit` has just accepted.
    """

    known: float
    low_n: float
    high_n: float
    first_n: float
    before_n: float
    suspect_s: float
    suspect_n: float
    admitted: Annotated[Array, 2, 2]


def begin(forces: np.void) -> None:
    """Initialises a record of zeros as one without forces."""
    forces["suspect_s"] = forces["suspect_n"] = np.nan
