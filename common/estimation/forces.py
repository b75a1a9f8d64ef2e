"""Rejection of outliers: a force is accepted if it is near the range of the forces so far.

The range begins with the median of the first three. A force that is beyond it by more than its width is
suspect, until the next one confirms it; then both count. So a single force far out, of whatever size, is
never held, and a wall that is really there costs one sample.
"""

import math
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.jit import Array, kernel

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


def begin(forces: NDArray[np.void]) -> None:
    """Initialises a record of zeros as one without forces."""
    forces["suspect_s"] = forces["suspect_n"] = np.nan


@kernel
def admit(forces: Forces, stamp: float, force_n: float) -> int:
    """Checks a force for an outlier; returns the number of forces accepted now, 0 to 2, in `admitted`.

    Counts it and extends the range. A force beyond the range by more than its width becomes the suspect; the
    next force accepts it, too, as the first in `admitted`, if the range that it extends comes near enough;
    else it is dropped. Does nothing if not finite or of the suspect's stamp.
    """
    if not (math.isfinite(force_n) and math.isfinite(stamp)) or stamp == forces.suspect_s:
        return 0
    _extend(forces, force_n)
    count = 0
    if _within_reach(forces, forces.suspect_n):
        forces.admitted[0, 0], forces.admitted[0, 1] = forces.suspect_s, forces.suspect_n
        count = 1
    forces.suspect_n = np.nan
    if forces.known < FIRST or _within_reach(forces, force_n):
        forces.admitted[count, 0], forces.admitted[count, 1] = stamp, force_n
        return count + 1
    forces.suspect_s, forces.suspect_n = stamp, force_n
    return count


@kernel
def _extend(forces: Forces, force_n: float) -> None:
    """Counts a force and extends the range of forces as far as two in a row reach.

    The first two set the range. At the third it restarts at the median of the three, which is kept as
    `first_n`.
    """
    forces.known += 1.0
    if forces.known < FIRST:
        first = forces.known == 1.0
        forces.low_n = force_n if first else min(force_n, forces.low_n)
        forces.high_n = force_n if first else max(force_n, forces.high_n)
        forces.before_n = force_n
        return
    if forces.known == FIRST:
        forces.low_n = forces.high_n = max(forces.low_n, min(forces.high_n, force_n))
        forces.first_n = forces.low_n
    forces.low_n = min(forces.low_n, max(force_n, forces.before_n))
    forces.high_n = max(forces.high_n, min(force_n, forces.before_n))
    forces.before_n = force_n


@kernel
def _within_reach(forces: Forces, force_n: float) -> bool:
    """True if a force is in the range, or beyond it by at most its width; False for NaN."""
    range_n = forces.high_n - forces.low_n
    return forces.low_n - range_n <= force_n <= forces.high_n + range_n
