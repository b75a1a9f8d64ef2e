"""Which forces are believed: those near the range of the forces seen so far.

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
"""So many forces tell a median; nothing is learned before."""


class Forces(Protocol):
    """known: forces seen. low_n, high_n: their range. first_n: f0, the median of the first three. before_n:
    the force seen last. suspect_s, suspect_n: the same where it is not believed yet, else NaN. admitted:
    (stamp, force) of those that `admit` believed.
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
    """Makes a record of zeros one that has seen nothing."""
    forces["suspect_s"] = forces["suspect_n"] = np.nan


@kernel
def admit(forces: Forces, stamp: float, force_n: float) -> int:
    """Takes a force in; how many are believed now: none, or it, or the suspect, or both, in `admitted`."""
    if not (math.isfinite(force_n) and math.isfinite(stamp)) or stamp == forces.suspect_s:
        return 0
    _see(forces, force_n)
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
def _see(forces: Forces, force_n: float) -> None:
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
    """False for NaN."""
    range_n = forces.high_n - forces.low_n
    return forces.low_n - range_n <= force_n <= forces.high_n + range_n
