"""Weights of the experts by their past errors.

For each force f that arrives, with p_e the prediction of expert e and h the error of the zero-order hold:

    loss_e = min((p_e - f)^2, c^2 max(h^2, mean h^2)),   c = 0.8 (1 + T / 10 s)
    v_e    = mean loss_e + (0.003 L)^2 + (0.1 L)^2 / (1 + I / (0.1 L^2) + (T / 6 s)^2)
    w_e    ~ v_e^-4
    reach  = mean of L, and while T < 5 s of the range of the forces where that is larger

The mean loss is that of the last 2 s (70 %) and 8 s (30 %), mean h^2 that of 8 s, the reach that of T / 4, at
most 2 s; L is the largest |f(t) - f(s)| so far, I the integral of h^2, T the time that has been judged. All
is relative to L, not to the range of the forces: by the range, recordings at rest went to ten times the error
of the hold.

The cap: an early extrapolation far off must not keep an expert out for 8 s. The last term of v_e makes all
alike while little is known. With 0.2 L, that kept the odd expert in the lead for ten seconds where others had
long been better. It is not for the favoured one, which is the odd expert (the first reversal), nor for an
expert that another run has taught: the contact with a prior or of a model.yaml. Losses of the taught are not
capped either: what was learned elsewhere may be wrong altogether, and is to go at its first contradiction.
Their weight is 1 + 10 / (1 + (T / 6 s)^2) times that of v_e: before the hand moves all are alike, and half of
the first push of a loaded friction was not foretold.

The blend goes no further than the reach from the newest force. Of a change larger than all before the experts
have learned the beginning alone, and foretell more of its size: 1.6 times the error of the hold where an
elastomer is let go, and 1.1 with the reach.

To v_e of the contact sigma^2 is added, what its last fit left unexplained: losses are those of the fits
before, and a fit to forces that no contact gives says anything at the next place. On a spring that is let go
that makes 1.7 of 2.2 times the error of the hold, and takes 3 % off two seals.

An expert without a prediction (NaN) is judged as the hold, and has no weight.
"""

import math
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation import experts
from forefeel.common.jit import Array, kernel

NAMES = ("zoh", *experts.NAMES, "contact", "contact, incremental")
ZOH, FIRST, CONTACT = 0, 1, 1 + len(experts.NAMES)
"""The hold, the five experts, the contact model, and last f(s) and the change of the contact since."""
MEMBERS = len(NAMES)

EARLY_S = 5.0
"""Judged time in which little is known of L and of the range of the forces."""

_MEMORIES_S = (2.0, 8.0)
_SHARES = (0.7, 0.3)
_CAP, _CAP_S = 0.8, 10.0
_FLOOR, _COLD, _COLD_ERRORS, _COLD_S = 0.003, 0.1, 0.1, 6.0
_REACH_S, _REACH_SHARE = 2.0, 0.25
_TRUST = 10.0
_KICK = 0.1
_TINY = 1e-200


class Blend(Protocol):
    """Sums of weighted losses by memory, of h^2 within 8 s, and of the weights; I; T; L; reach; sigma; w.

    taught: 1 for each member that another run has taught.
    """

    seen_fast: float
    seen_slow: float
    zoh_n2: float
    informed_n2: float
    known_s: float
    largest_n: float
    reach_n: float
    unexplained_n: float
    losses: Annotated[Array, 2, MEMBERS]
    weights: Annotated[Array, MEMBERS]
    taught: Annotated[Array, MEMBERS]


def begin(blend: NDArray[np.void], taught: bool) -> None:
    """Initialises a record of zeros: all weight is on the change of a taught contact, else on the hold."""
    blend["weights"][:, CONTACT + 1 if taught else ZOH] = 1.0
    blend["taught"][:, CONTACT:] = taught


@kernel
def judge(blend: Blend, members_n: Array, force_n: float, range_n: float, h: float) -> None:
    """Updates losses, reach and weights of a blend by a force that has arrived; `h`: its time in s.

    `members_n`: what each member predicted for it in N, first the zero-order hold; one with NaN gets the loss
    of the hold. Losses are squared errors, capped but for members that another run has taught. `range_n`: of
    all forces, counts for the reach in the first 5 s.
    """
    error_n2 = (force_n - members_n[ZOH]) ** 2
    keep_fast, keep_slow = math.exp(-h / _MEMORIES_S[0]), math.exp(-h / _MEMORIES_S[1])
    blend.seen_fast = blend.seen_fast * keep_fast + h
    blend.seen_slow = blend.seen_slow * keep_slow + h
    blend.zoh_n2 = blend.zoh_n2 * keep_slow + h * error_n2
    blend.informed_n2 += h * error_n2
    blend.known_s += h
    blend.largest_n = max(blend.largest_n, math.sqrt(error_n2))
    largest_n = max(blend.largest_n, range_n) if blend.known_s < EARLY_S else blend.largest_n
    memory_s = min(_REACH_S, _REACH_SHARE * blend.known_s)
    blend.reach_n += (largest_n - blend.reach_n) * (1.0 - math.exp(-h / memory_s))
    cap = (_CAP * (1.0 + blend.known_s / _CAP_S)) ** 2 * max(error_n2, blend.zoh_n2 / blend.seen_slow)
    for e in range(MEMBERS):
        loss = error_n2 if math.isnan(members_n[e]) else (members_n[e] - force_n) ** 2
        if blend.taught[e] == 0.0:
            loss = min(loss, cap)
        blend.losses[0, e] = blend.losses[0, e] * keep_fast + h * loss
        blend.losses[1, e] = blend.losses[1, e] * keep_slow + h * loss
    _weigh(blend)


@kernel
def _weigh(blend: Blend) -> None:
    """Sets the members' weights, of sum 1, in proportion to v^-4: v is the mean loss and what is added.

    Added are a floor by the largest error of the hold, sigma^2 for the contact, and while little is known a
    term that makes all alike but the odd expert and taught members; taught ones get up to 11 times the
    weight.
    """
    weights, largest_n2 = blend.weights, blend.largest_n * blend.largest_n
    known = blend.informed_n2 / (_COLD_ERRORS * largest_n2 + _TINY) + (blend.known_s / _COLD_S) ** 2
    cold = _COLD * _COLD * largest_n2 / (1.0 + known)
    fast, slow = _SHARES[0] / blend.seen_fast, _SHARES[1] / blend.seen_slow
    least = math.inf
    for e in range(MEMBERS):
        weights[e] = fast * blend.losses[0, e] + slow * blend.losses[1, e] + _FLOOR**2 * largest_n2 + _TINY
        if blend.taught[e] == 0.0 and e != FIRST + experts.ODD:
            weights[e] += cold
        if e >= CONTACT:
            weights[e] += blend.unexplained_n * blend.unexplained_n
        least = min(least, weights[e])
    total = 0.0
    for e in range(MEMBERS):
        weights[e] = (least / weights[e]) ** 4
        if blend.taught[e] > 0.0:
            weights[e] *= 1.0 + _TRUST / (1.0 + (blend.known_s / _COLD_S) ** 2)
        total += weights[e]
    for e in range(MEMBERS):
        weights[e] /= total


@kernel
def mean(weights: Array, members_n: Array) -> tuple[float, float, int]:
    """Returns (weighted mean of predictions in N, their variance in N^2, index of the leader); skips NaN.

    The leader has the largest weight. If their weights are all 0, returns (prediction of the hold, 0, `ZOH`).
    """
    total = force_n = 0.0
    leading = ZOH
    for e in range(MEMBERS):
        if not math.isnan(members_n[e]):
            total += weights[e]
            force_n += weights[e] * members_n[e]
            leading = e if weights[e] > weights[leading] else leading
    if total == 0.0:
        return members_n[ZOH], 0.0, ZOH
    force_n /= total
    variance_n2 = 0.0
    for e in range(MEMBERS):
        if not math.isnan(members_n[e]):
            variance_n2 += weights[e] / total * (members_n[e] - force_n) ** 2
    return force_n, variance_n2, leading


@kernel
def discount(blend: Blend) -> None:
    """Reduces the weight of past errors to a tenth."""
    blend.losses *= _KICK
    blend.seen_fast *= _KICK
    blend.seen_slow *= _KICK
    blend.zoh_n2 *= _KICK
