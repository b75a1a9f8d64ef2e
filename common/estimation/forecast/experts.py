"""Several ways to predict, each with its own strengths, and how much each is to be trusted.

With phi(t) the regressors now, f(s) the newest force that has arrived and phi(s) those of its stamp:

    plain         f0 + phi(t)' theta                           knows the contact
    incremental   f(s) + (phi(t) - phi(s))' theta              knows what has changed since the newest force

for each set of regressors and memory, and both again for each model from outside (the one of a model.yaml, as
it has been identified and as it was loaded). What each has predicted is kept until the force of that stamp
arrives: only errors that have been seen count. The weights are mse^-4 of the mean squared errors of the last
2 s and 8 s, above a floor that is large until the motion has told something; it is not for a model as it was
loaded, which another run has taught.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.forecast.bank import RING, Array, Bank
from forefeel.common.estimation.forecast.regression import LONG, SETS, SHORT, SHORT_SETS, Regression
from forefeel.common.jit import fast_kernel, floats, kernel, record

_WORDS = ("m-b-k", "friction", "relaxation", "differences", "nonlinear")

TABLE = np.array([[LONG, k] for k in range(len(SETS))] + [[SHORT, k] for k in SHORT_SETS])
"""(memory, set) of each pair of a plain and an incremental expert."""

OUTSIDE = 2 * len(TABLE)
MODELS = 2
TAUGHT = OUTSIDE + 2
"""Models from outside, at most; the second one is as it was loaded, which another run has taught."""
COUNT = OUTSIDE + 2 * MODELS
NAMES = (
    *(
        f"{_WORDS[k]}{'' if memory == LONG else ', recent'}{kind}"
        for memory, k in TABLE.tolist()
        for kind in ("", ", incremental")
    ),
    "model",
    "model, incremental",
    "model as loaded",
    "model as loaded, incremental",
)

_MEMORIES_S = (2.0, 8.0)
_SHARES = (0.7, 0.3)
_KICK = 0.1
_FLOOR, _COLD_FLOOR, _COLD = 0.005, 0.1, 0.02

DTYPE = record(
    "seen_fast seen_slow informed outside",
    floats("predicted_n", RING, COUNT),
    floats("squares", 2, COUNT),
    floats("weights", COUNT),
    floats("outside_n", RING, MODELS),
)


class Experts(Protocol):
    """A record of `DTYPE`: predictions by sample, NaN where none; sums of squared errors by memory; weights.

    seen_*: sums of the weights of the errors. informed: sum of the hold's squared errors. outside: how many
    models from outside take part, whose forces by sample are `outside_n`.
    """

    seen_fast: float
    seen_slow: float
    informed: float
    outside: float
    predicted_n: Array
    squares: Array
    weights: Array
    outside_n: Array


def begin(experts: NDArray[np.void], outside: int) -> None:
    """Makes a record of zeros one in which nobody has been wrong yet."""
    experts["outside"] = float(outside)
    experts["predicted_n"] = experts["outside_n"] = np.nan


@kernel
def count(experts: Experts) -> int:
    """How many experts take part."""
    return OUTSIDE + 2 * int(experts.outside)


@kernel
def predict(
    experts: Experts, regression: Regression, bank: Bank, now: int, newest: int, held_n: float
) -> None:
    """Every expert's force for sample `now`, given the force `held_n` of sample `newest`."""
    i, j = now % RING, newest % RING
    said, force0_n = experts.predicted_n[i], regression.force0_n
    for e in range(len(TABLE)):
        theta, n = regression.theta[TABLE[e, 0], TABLE[e, 1]], SETS[TABLE[e, 1]]
        here = _dot(bank.phi[i], theta, n)
        said[2 * e] = force0_n + here
        said[2 * e + 1] = held_n + here - _dot(bank.phi[j], theta, n)
    for k in range(int(experts.outside)):
        model_n, then_n = experts.outside_n[i, k], experts.outside_n[j, k]
        said[OUTSIDE + 2 * k] = held_n if np.isnan(model_n) else model_n
        said[OUTSIDE + 2 * k + 1] = held_n if np.isnan(model_n - then_n) else held_n + model_n - then_n


@kernel
def clip(experts: Experts, now: int, low_n: float, high_n: float) -> None:
    """Keeps every expert's force for sample `now` within bounds, but of those that were taught before."""
    said = experts.predicted_n[now % RING]
    for e in range(min(TAUGHT, count(experts))):
        said[e] = min(high_n, max(low_n, said[e]))


@fast_kernel
def _dot(a: Array, b: Array, n: int) -> float:
    total = 0.0
    for k in range(n):
        total += a[k] * b[k]
    return total


@kernel
def judge(experts: Experts, n: int, force_n: float, held_error_n: float, range_n: float, w: float) -> None:
    """The force of sample n has arrived: errors, then weights. `w`: the time in s that it stands for."""
    keep_fast, keep_slow = np.exp(-w / _MEMORIES_S[0]), np.exp(-w / _MEMORIES_S[1])
    experts.seen_fast = experts.seen_fast * keep_fast + w
    experts.seen_slow = experts.seen_slow * keep_slow + w
    experts.informed += w * held_error_n * held_error_n
    for e in range(count(experts)):
        error_n = experts.predicted_n[n % RING, e] - force_n
        experts.squares[0, e] = experts.squares[0, e] * keep_fast + w * error_n * error_n
        experts.squares[1, e] = experts.squares[1, e] * keep_slow + w * error_n * error_n
    _weigh(experts, range_n)


@kernel
def _weigh(experts: Experts, range_n: float) -> None:
    weights = experts.weights
    range2 = range_n * range_n
    floor = _FLOOR**2 * range2
    cold = _COLD_FLOOR**2 * range2 / (1.0 + experts.informed / (_COLD * range2 + 1e-200))
    fast, slow = _SHARES[0] / experts.seen_fast, _SHARES[1] / experts.seen_slow
    least, members = np.inf, count(experts)
    for e in range(members):
        weights[e] = fast * experts.squares[0, e] + slow * experts.squares[1, e] + floor + 1e-200
        weights[e] += cold if e < TAUGHT else 0.0
        least = min(least, weights[e])
    total = 0.0
    for e in range(members):
        weights[e] = (least / weights[e]) ** 4
        total += weights[e]
    for e in range(members):
        weights[e] /= total


@kernel
def blend(experts: Experts, now: int) -> tuple[float, int]:
    """(weighted mean of the experts in N, number of the one with the largest weight) for sample `now`."""
    said, weights = experts.predicted_n[now % RING], experts.weights
    force_n, leading = 0.0, 0
    for e in range(count(experts)):
        force_n += weights[e] * said[e]
        if weights[e] > weights[leading]:
            leading = e
    return force_n, leading


@kernel
def taught(experts: Experts) -> float:
    """Weight of the model as it was loaded, 0 to 1."""
    return float(experts.weights[TAUGHT] + experts.weights[TAUGHT + 1])


@kernel
def spread(experts: Experts, now: int, force_n: float) -> float:
    """Weighted mean squared deviation of the experts from `force_n`, in N^2."""
    said, weights = experts.predicted_n[now % RING], experts.weights
    total = 0.0
    for e in range(count(experts)):
        total += weights[e] * (said[e] - force_n) ** 2
    return total


@kernel
def plain_error_n(experts: Experts, n: int, force_n: float) -> float:
    """Error for sample n of the plain expert with the largest weight."""
    best = 0
    for e in range(0, OUTSIDE, 2):
        if experts.weights[e] > experts.weights[best]:
            best = e
    return float(experts.predicted_n[n % RING, best]) - force_n


@kernel
def discount(experts: Experts) -> None:
    """Leaves the errors seen a tenth of their weight."""
    experts.squares *= _KICK
    experts.seen_fast *= _KICK
    experts.seen_slow *= _KICK
