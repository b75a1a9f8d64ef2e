"""How far to go from the newest force towards the blend: less where going there has not paid.

A deviation d of the blend from the held force is scaled by the regression of what was needed, f - hold, on
what was proposed, d, over those that have been seen, separately for each size of d (octaves of a newton,
linear between their centres). So a slow push that learns "small deviations are noise" does not veto the first
large reversal. Before anything of that size has been seen, the prior trusts d, more for an older held force.

The deviation is capped by the largest that proved right, at first by the largest error that the hold has
made, but not as far as it comes from a model that was taught before; and the prediction changes from sample
to sample no faster than forces have been seen to change.
"""

import math
from typing import Protocol

from forefeel.common.estimation.forecast.bank import Array
from forefeel.common.jit import floats, kernel, record

_BINS, _ZERO_BIN = 96, 60
_MEMORY_S = 5.0
_PRIOR = 6.0
_SIDE = 0.5
_KICK = 0.1
_COLD_S = 5.0
_COLD_AGE_S = 0.25
_LONGEST_AGE_S = 0.5

DTYPE = record("seen_s largest_right_n largest_error_n", floats("sums", 2, _BINS))


class Gain(Protocol):
    """A record of `DTYPE`: sums, by bin, of w d (f - hold) and of w d^2; what has been largest so far."""

    seen_s: float
    largest_right_n: float
    largest_error_n: float
    sums: Array


@kernel
def _bin(deviation_n: float) -> float:
    return min(_BINS - 3.0, max(2.0, math.log2(abs(deviation_n) + 1e-100) + _ZERO_BIN))


@kernel
def learn(gain: Gain, deviation_n: float, needed_n: float, w: float) -> None:
    """What was needed, f - hold, where the blend had proposed `deviation_n`."""
    place = _bin(deviation_n)
    low = int(place)
    gain.sums[:, :] *= math.exp(-w / _MEMORY_S)
    for b, share in ((low, 1.0 - place + low), (low + 1, place - low)):
        gain.sums[0, b] += share * w * deviation_n * needed_n
        gain.sums[1, b] += share * w * deviation_n * deviation_n
    gain.seen_s += w
    gain.largest_error_n = max(gain.largest_error_n, abs(needed_n))
    if deviation_n * needed_n > 0.0:
        gain.largest_right_n = max(gain.largest_right_n, min(abs(deviation_n), abs(needed_n)))


@kernel
def applied(gain: Gain, deviation_n: float, age_s: float, range_n: float, taught: float) -> float:
    """The deviation to apply in N; `age_s`: of the held force, `range_n`: of the forces seen, `taught`: the
    weight of what another run has taught, which is not capped."""
    place = _bin(deviation_n)
    low, share = int(place), 0.0
    for b, part in ((low, 1.0 - place + low), (low + 1, place - low)):
        prior = _PRIOR * age_s * 4.0 ** (b - _ZERO_BIN) + 1e-200
        needed = gain.sums[0, b] + _SIDE * (gain.sums[0, b - 1] + gain.sums[0, b + 1]) + prior
        proposed = gain.sums[1, b] + _SIDE * (gain.sums[1, b - 1] + gain.sums[1, b + 1]) + prior
        share += part * min(1.0, max(0.0, needed / proposed))
    cap_n = max(_cap_n(gain, age_s, range_n), taught * abs(deviation_n))
    return min(cap_n, max(-cap_n, share * deviation_n))


@kernel
def _cap_n(gain: Gain, age_s: float, range_n: float) -> float:
    cold_n = max(gain.largest_error_n, range_n * min(1.0, age_s / _COLD_AGE_S))
    cold_n /= 1.0 + (gain.seen_s / _COLD_S) ** 2
    return max((1.0 + min(age_s, _LONGEST_AGE_S)) * gain.largest_right_n, cold_n)


@kernel
def discount(gain: Gain) -> None:
    """Leaves what was learned a tenth of its weight."""
    gain.sums *= _KICK
