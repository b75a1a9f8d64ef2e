"""Another tissue, another grip: notices that no model fits any more, so that the long memory lets go.

The error of the plain expert that is trusted most is set against its usual size, the mean of the last 30 s.
A clock runs while it is over three times the usual and runs back while it is not; at half a second there is
a kick. A reversal or an outlier is over before that. The usual then starts from the errors of now, and the
next kick is 10 s away at the earliest: one change is one kick, and what is merely harder to predict none.
"""

import math
from typing import Protocol

from forefeel.common.jit import kernel

_USUAL_MEMORY_S = 30.0
_NOW_MEMORY_S = 0.5
_LARGE = 3.0
_PATIENCE_S = 0.5
_APART_S = 10.0
_OF_RANGE = 1e-3


class Change(Protocol):
    """Sums of weighted |e| and of the weights in both memories; the clock; the time in s
    since the first error or the last kick."""

    usual: float
    weight: float
    now: float
    now_weight: float
    clock_s: float
    since_s: float


@kernel
def noticed(change: Change, error_n: float, range_n: float, w: float) -> bool:
    """Takes in an error of the model, `w`: the time in s that it stands for; whether this is a kick.

    Errors below a thousandth of `range_n`, the range of the forces, are nothing unusual.
    """
    size_n = abs(error_n)
    usual_n = change.usual / (change.weight + 1e-9) + _OF_RANGE * range_n
    large = size_n > _LARGE * usual_n
    keep, keep_now = math.exp(-w / _USUAL_MEMORY_S), math.exp(-w / _NOW_MEMORY_S)
    change.usual = change.usual * keep + w * size_n
    change.weight = change.weight * keep + w
    change.now = change.now * keep_now + w * size_n
    change.now_weight = change.now_weight * keep_now + w
    change.since_s += w
    change.clock_s = change.clock_s + w if large else max(0.0, change.clock_s - w)
    if change.clock_s < _PATIENCE_S or change.since_s < _APART_S:
        return False
    change.clock_s = change.since_s = 0.0
    change.usual, change.weight = change.now / change.now_weight, 1.0
    return True
