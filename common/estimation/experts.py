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

from typing import Annotated, Protocol

import numpy as np

from forefeel.common.estimation.bank import COUNT, FIRST_RELAXATION, STOPS
from forefeel.common.kernels.record import Array

LAGS_S = (0.03, 0.06, 0.1, 0.2, 0.4, 0.8)

THEN = COUNT
HELD = THEN + COUNT - 1
PAST = HELD + 1
STEP = PAST + len(LAGS_S)
ROW = STEP + FIRST_RELAXATION - 1
"""Starts of the parts of u, and its length."""

NAMES = ("autoregression", "friction", "absolute", "plain", "odd")
AUTOREGRESSION, FRICTION, ABSOLUTE, PLAIN, ODD = range(len(NAMES))


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


def begin(learning: np.void) -> None:
    """Initialises a record of zeros: theta is 0, and the first force is solved at once."""
    learning["solved_s"] = -1e18
