"""Least squares in information form, regularised: late forces onto the bank's regressors.

    R <- lambda R + w phi phi',   r <- lambda r + w phi (f - f0),   theta = (R + D)^-1 r

with w the time that a sample stands for and lambda = exp(-w / memory). The ridge D_jj = rho g_j R_jj / W (W:
the sum of the weights) is the information of rho g_j seconds of regressor j at its usual size, so that no
regressor needs a scale. What the motion does not tell apart the ridge decides, in favour of small theta; it
does not fade with the memory, so nothing winds up. Of the two memories the short one is drawn to the long
one's theta instead of to zero.

Nested sets of regressors, the first `SETS[i]` of the bank, share one Cholesky factor: leading minors.

At standstill nothing is added or forgotten: an hour of rest must not outweigh what the motion has taught.

References: Hoerl and Kennard, Technometrics 12(1), 1970, ridge; Ljung, System Identification (1999), 11.2.
"""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.forecast.bank import (
    COUNT,
    FIRST_DIFFERENCE,
    FIRST_NONLINEAR,
    FIRST_RELAXATION,
    FIRST_STOP,
    NO_OCTAVE,
    RING,
    STOPS,
    Array,
    Bank,
)
from forefeel.common.jit import fast_kernel, floats, kernel, record

SETS = (4, FIRST_RELAXATION, FIRST_DIFFERENCE, FIRST_NONLINEAR, COUNT)
"""m-b-k and bias; and friction; and relaxation; and differences; and what is not linear."""

LONG, SHORT = 0, 1
SHORT_SETS = (2, 4)
"""The sets that are fitted within the short memory, too."""
MEMORIES_S = (120.0, 8.0)
_RHO_S = (0.05, 1.0)
_SOLVE_EVERY_S = 0.004
_REST_S = 2.0
_KICK_S = 0.2
_LEAST_STOP = 0.3
"""A stop's mean square is taken as at least this: one that has just been made has hardly any history."""
_JITTER = 1e-10
_TINY = 1e-200

DTYPE = record(
    "weight_long solved_s force0_n",
    floats("information", 2, COUNT, COUNT),
    floats("moments", 2, COUNT),
    floats("theta", 2, len(SETS), COUNT),
    floats("shares", COUNT),
    floats("factor", COUNT, COUNT),
    floats("matrix", COUNT, COUNT),
    floats("rest", COUNT),
    floats("solution", COUNT),
)


class Regression(Protocol):
    """A record of `DTYPE`: R by memory (lower triangles), r, theta by memory and set, g; and working room.

    weight_long: W. solved_s: stamp of the last solution. force0_n: f0, the first force.
    """

    weight_long: float
    solved_s: float
    force0_n: float
    information: Array
    moments: Array
    theta: Array
    shares: Array
    factor: Array
    matrix: Array
    rest: Array
    solution: Array


def begin(regression: NDArray[np.void]) -> None:
    """Makes a record of zeros one that knows nothing: theta = 0."""
    regression["solved_s"] = -1e18
    shares = regression["shares"]
    shares[:] = 1.0
    shares[:, 0] = 0.001  # a bias is nearly always there
    shares[:, 2:4] = shares[:, FIRST_DIFFERENCE:FIRST_NONLINEAR] = 0.1
    shares[:, FIRST_NONLINEAR:] = 3.0


@kernel
def at_rest(bank: Bank, n: int) -> bool:
    """Whether the motion has stood still up to sample n for so long that it teaches nothing any more."""
    return bank.t_s[n % RING] - bank.moved_s > _REST_S and bank.octave != NO_OCTAVE


@kernel
def learn(regression: Regression, bank: Bank, n: int, force_n: float) -> None:
    """Adds the force of sample n; solves anew when that was last done more than 4 ms of stamps ago."""
    t = bank.t_s[n % RING]
    if at_rest(bank, n):
        return
    w = min(max(bank.period_s, 1e-4), 0.05)
    phi, y = bank.phi[n % RING], force_n - regression.force0_n
    keep_long, keep_short = math.exp(-w / MEMORIES_S[LONG]), math.exp(-w / MEMORIES_S[SHORT])
    _add(regression.information[LONG], regression.moments[LONG], phi, y, w, keep_long)
    _add(regression.information[SHORT], regression.moments[SHORT], phi, y, w, keep_short)
    regression.weight_long = regression.weight_long * keep_long + w
    if t - regression.solved_s >= _SOLVE_EVERY_S:
        solve(regression)
        regression.solved_s = t


@fast_kernel
def _add(information: Array, moments: Array, phi: Array, y: float, w: float, keep: float) -> None:
    for i in range(COUNT):
        weighted = w * phi[i]
        moments[i] = keep * moments[i] + weighted * y
        for j in range(i + 1):
            information[i, j] = keep * information[i, j] + weighted * phi[j]


@kernel
def forget_renewed(regression: Regression, bank: Bank) -> None:
    """Clears what was known of stops that have a new radius, and solves without it."""
    any_renewed = False
    for slot in range(STOPS):
        if bank.renewed[slot] > 0.0:
            j = FIRST_STOP + slot
            regression.information[:, j, :] = 0.0
            regression.information[:, :, j] = 0.0
            regression.moments[:, j] = 0.0
            regression.theta[:, :, j] = 0.0
            any_renewed = True
    if any_renewed and regression.weight_long > 0.0:
        solve(regression)


@kernel
def solve(regression: Regression) -> None:
    """theta of every set, first within the long memory, then beside it within the short one."""
    _factorise(regression, LONG)
    for k in range(len(SETS)):
        _solve_set(regression, LONG, k)
    _factorise(regression, SHORT)
    for k in SHORT_SETS:
        _solve_set(regression, SHORT, k)


@kernel
def _factorise(regression: Regression, memory: int) -> None:
    """Cholesky factor of R + D."""
    weight = regression.weight_long + 1e-9
    a, information = regression.matrix, regression.information[memory]
    for i in range(COUNT):
        for j in range(i):
            a[i, j] = information[i, j]
        size = regression.information[LONG, i, i]
        usual = size / weight
        if FIRST_STOP <= i < FIRST_RELAXATION:
            usual = max(usual, _LEAST_STOP)
        ridge = _RHO_S[memory] * regression.shares[i] * usual
        a[i, i] = information[i, i] + ridge + _JITTER * size + _TINY
    _cholesky(a, regression.factor)


@fast_kernel
def _cholesky(a: Array, factor: Array) -> None:
    for i in range(COUNT):
        for j in range(i):
            total = a[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total / factor[j, j]
        total = a[i, i]
        for k in range(i):
            total -= factor[i, k] * factor[i, k]
        least = 1e-14 * a[i, i]
        factor[i, i] = math.sqrt(total if total > least else least + _TINY)


@fast_kernel
def _solve_set(regression: Regression, memory: int, k: int) -> None:
    """(R + D) (theta - prior) = r - R prior, for the first SETS[k] regressors."""
    n, factor, y = SETS[k], regression.factor, regression.solution
    prior, theta = regression.theta[LONG, k], regression.theta[memory, k]
    information, moments = regression.information[memory], regression.moments[memory]
    for i in range(n):
        total = moments[i]
        if memory == SHORT:
            for j in range(i + 1):
                total -= information[i, j] * prior[j]
            for j in range(i + 1, n):
                total -= information[j, i] * prior[j]
        regression.rest[i] = total
    for i in range(n):
        total = regression.rest[i]
        for j in range(i):
            total -= factor[i, j] * y[j]
        y[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        y[i] /= factor[i, i]
        for j in range(i):
            y[j] -= factor[i, j] * y[i]
    for i in range(n):
        theta[i] = y[i] + (prior[i] if memory == SHORT else 0.0)


@kernel
def discount(regression: Regression) -> None:
    """Leaves what was learned the weight of 0.2 s: enough to begin with, too little to stand in the way."""
    for memory in range(len(MEMORIES_S)):
        share = _KICK_S / max(_KICK_S, min(regression.weight_long, MEMORIES_S[memory]))
        regression.information[memory] *= share
        regression.moments[memory] *= share
    regression.weight_long = min(regression.weight_long, _KICK_S)
