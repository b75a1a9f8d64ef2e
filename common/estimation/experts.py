"""Five experts of one class: recursive least squares in information form, regularised, on late forces.

    R <- lambda R + h u u',   r <- lambda r + h u y,   lambda = exp(-h / T),   T = 120 s
    theta = (R + D)^-1 r,     D_jj = rho g_j R_jj / W

h is the time of a sample, W the sum of h: the ridge D is the information of rho g_j seconds of regressor j at
its usual size, so that no regressor needs a scale or a unit. The ridge decides what the motion does not
determine, in favour of small theta; it does not fade, so nothing winds up. At standstill nothing is added or
forgotten: an hour of rest must not outweigh the motion before.

With phi the regressors of the motion (`bank`), t now, s the stamp of the newest force, f0 the force
before motion, and a(l) = f(s) - f(s - l) the past of the force at six lags l, all experts are ranges of one
row

    u = (phi(t) | phi(s) | f(s) - f0 | a | phi(t) - phi(s), the first twelve)

so that one R serves them all. In the table dphi = phi(t) - phi(s).

| expert | regressors | learns y | predicts | why |
|---|---|---|---|---|
| autoregression | a | f(t) - f(s) | f(s) + z' theta | what the force goes on to do by itself |
| friction | a, dphi 1-12 | f(t) - f(s) | f(s) + z' theta | what the motion since s has changed |
| absolute | phi(t), phi(s), f(s) - f0, a | f(t) - f(s) | f(s) + z' theta | all that is known |
| plain | phi(t) | f - f0 | f0 + z' theta | the contact, without the noise of f(s) |
| odd | phi 1-12, no bias | f - f0 | f(s) + dphi' theta | the first reversal: friction is odd in v |

No prediction is further from its start than 1.3 times the largest y so far; that of the odd expert twice the
largest |f - f0|, because a reversal turns a friction of which one side is known.

References: Hoerl and Kennard, Technometrics 12(1), 1970, ridge; Ljung, System Identification (1999), 11.2.
"""

import math
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.bank import (
    COUNT,
    FIRST_DIFFERENCE,
    FIRST_NONLINEAR,
    FIRST_RELAXATION,
    FIRST_STOP,
    STOPS,
    Bank,
)
from forefeel.common.jit import Array, fast_kernel, kernel

LAGS_S = (0.03, 0.06, 0.1, 0.2, 0.4, 0.8)

THEN = COUNT
HELD = THEN + COUNT - 1
PAST = HELD + 1
STEP = PAST + len(LAGS_S)
ROW = STEP + FIRST_RELAXATION - 1
"""Starts of the parts of u, and its length."""

NAMES = ("autoregression", "friction", "absolute", "plain", "odd")
AUTOREGRESSION, FRICTION, ABSOLUTE, PLAIN, ODD = range(len(NAMES))
_BEGIN = np.array([PAST, PAST, 0, 0, 1])
_END = np.array([STEP, ROW, STEP, COUNT, FIRST_RELAXATION])
_LEVEL = np.array([0, 0, 0, 1, 1])
"""Moments by expert: 0 of f(t) - f(s), 1 of f - f0."""
_RHO_S = np.array([0.05, 0.05, 0.03, 0.05, 0.05])

_MEMORY_S = 120.0
_SOLVE_EVERY_S = 0.02
_KICK_S = 0.2
_LEAST_STOP = 0.3  # least mean square of a stop: a new one has hardly any history
_REACH, _ODD_REACH = 1.3, 2.0
_JITTER = 1e-10
_TINY = 1e-200


def _shares() -> NDArray[np.float64]:
    """g of every column of u."""
    phi = np.ones(COUNT)
    phi[0] = 0.001  # a bias is nearly always there
    phi[2:4] = phi[FIRST_DIFFERENCE:FIRST_NONLINEAR] = 0.1
    phi[FIRST_NONLINEAR:] = 3.0
    return np.concatenate((phi, phi[1:], np.ones(1 + len(LAGS_S)), phi[1:FIRST_RELAXATION]))


_SHARES = _shares()


class Learning(Protocol):
    """R (its lower triangle) and r of both levels; W; theta by expert; stamp of the last solution in s; radii
    of the stops in what was learned; and work arrays.
    """

    weight_s: float
    solved_s: float
    radii_m: Annotated[Array, STOPS]
    information: Annotated[Array, ROW, ROW]
    moments: Annotated[Array, 2, ROW]
    theta: Annotated[Array, len(NAMES), ROW]
    factor: Annotated[Array, ROW, ROW]
    solution: Annotated[Array, ROW]


def begin(learning: NDArray[np.void]) -> None:
    """Initialises a record of zeros: theta is 0, and the first force is solved at once."""
    learning["solved_s"] = -1e18


@kernel
def fill(row: Array, bank: Bank, now: int, newest: int, held_n: float) -> None:
    """Sets the part of u that the motion gives: phi at ring place `now`, at `newest`, and their differences.

    `newest`: of the newest force; `held_n`: f(s) - f0, also set. The past of the force is left to the caller.
    """
    phi, then = bank.phi[now], bank.phi[newest]
    row[:COUNT] = phi
    row[THEN:HELD] = then[1:]
    row[HELD] = held_n
    for j in range(ROW - STEP):
        row[STEP + j] = phi[1 + j] - then[1 + j]


@kernel
def clear_stop(rows: Array, stop: int) -> None:
    """Sets the columns of a stop whose radius has changed to 0."""
    k = FIRST_STOP + stop
    rows[:, k] = 0.0
    rows[:, THEN + k - 1] = 0.0
    rows[:, STEP + k - 1] = 0.0


@fast_kernel
def predict(
    experts_n: Array,
    theta: Array,
    row: Array,
    held_n: float,
    level_n: float,
    largest_step_n: float,
    largest_n: float,
) -> None:
    """Sets `experts_n`, the force in N that each expert predicts: f(s), or f0 for `plain`, plus row' theta.

    `held_n`: f(s), the newest force; `level_n`: f0. What is added is cut to 1.3 `largest_step_n`, the largest
    |f(t) - f(s)| so far; for `plain` to 1.3 and for `odd` to 2 times `largest_n`, the largest |f - f0|.
    """
    for e in range(len(NAMES)):
        change_n, shift = 0.0, STEP - 1 if e == ODD else 0
        for j in range(_BEGIN[e], _END[e]):
            change_n += theta[e, j] * row[shift + j]
        reach_n = _REACH * largest_step_n
        if _LEVEL[e] == 1:
            reach_n = (_ODD_REACH if e == ODD else _REACH) * largest_n
        base_n = level_n if e == PLAIN else held_n
        experts_n[e] = base_n + min(reach_n, max(-reach_n, change_n))


@kernel
def learn(learning: Learning, row: Array, stamp_s: float, step_n: float, force_n: float, h: float) -> None:
    """Adds a row u with its targets in N to R and r, which fade over 120 s; solves for theta every 20 ms.

    `step_n` = f(t) - f(s), `force_n` = f - f0; `h`: the time in s it stands for, its weight.
    """
    keep = math.exp(-h / _MEMORY_S)
    _add(learning, row, step_n, force_n, h, keep)
    learning.weight_s = learning.weight_s * keep + h
    if stamp_s - learning.solved_s >= _SOLVE_EVERY_S:
        solve(learning)
        learning.solved_s = stamp_s


@fast_kernel
def _add(learning: Learning, row: Array, step_n: float, force_n: float, h: float, keep: float) -> None:
    """Multiplies R (lower triangle) and both r by `keep`, and adds the products of the row with weight h."""
    information, moments = learning.information, learning.moments
    for i in range(ROW):
        weighted = h * row[i]
        moments[0, i] = keep * moments[0, i] + weighted * step_n
        moments[1, i] = keep * moments[1, i] + weighted * force_n
        for j in range(i + 1):
            information[i, j] = keep * information[i, j] + weighted * row[j]


@kernel
def renew_stops(learning: Learning, radii_m: Array) -> None:
    """Takes over the stops' radii in m; for each that differs, sets what was learned with that stop to 0.

    These are its rows and columns of R and its entries of r and theta.
    """
    for j in range(STOPS):
        if learning.radii_m[j] != radii_m[j]:
            learning.radii_m[j] = radii_m[j]
            clear_stop(learning.information, j)
            clear_stop(learning.information.T, j)
            clear_stop(learning.moments, j)
            clear_stop(learning.theta, j)


@kernel
def solve(learning: Learning) -> None:
    for e in range(len(NAMES)):
        _solve(learning, e)


@fast_kernel
def _solve(learning: Learning, e: int) -> None:
    """Sets theta of expert e to (R + D)^-1 r within its range of u, by a Cholesky factor; R and r stay."""
    information, moments, theta = learning.information, learning.moments[_LEVEL[e]], learning.theta[e]
    factor, y, weight_s = learning.factor, learning.solution, learning.weight_s
    begin, end, rho_s = _BEGIN[e], _END[e], _RHO_S[e]
    for i in range(begin, end):
        for j in range(begin, i + 1):
            total = information[i, j]
            for k in range(begin, j):
                total -= factor[i, k] * factor[j, k]
            if j < i:
                factor[i, j] = total / factor[j, j]
            else:
                size = information[i, i]
                usual = size / weight_s
                if FIRST_STOP <= i < FIRST_RELAXATION:
                    usual = max(usual, _LEAST_STOP)
                total += rho_s * _SHARES[i] * usual + _JITTER * size + _TINY
                factor[i, i] = math.sqrt(max(total, 1e-14 * size + _TINY))
    for i in range(begin, end):
        total = moments[i]
        for j in range(begin, i):
            total -= factor[i, j] * y[j]
        y[i] = total / factor[i, i]
    for i in range(end - 1, begin - 1, -1):
        y[i] /= factor[i, i]
        theta[i] = y[i]
        for j in range(begin, i):
            y[j] -= factor[i, j] * y[i]


@kernel
def discount(learning: Learning) -> None:
    """Reduces the weight of what was learned to 0.2 s: enough to begin with, little against new forces."""
    share = _KICK_S / max(_KICK_S, learning.weight_s)
    learning.information *= share
    learning.moments *= share
    learning.weight_s *= share
