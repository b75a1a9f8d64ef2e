"""Ring of the last `RING` samples of the motion with their regressors: `COUNT` numbers phi each, from which
the experts predict the force.

| phi | what | why |
|---|---|---|
| 0 to 3 | 1, x - x0, v, a | bias and equation (1) of the paper |
| 4 | tanh(v / 0.1 v_rms) | Coulomb friction |
| 5 to 12 | stop operators z / r at eight radii r, octaves of the range | presliding and hysteresis |
| 13 to 18 | x and friction, each less its mean over 0.1, 1, 10 s | relaxation |
| 19 to 33 | first to third differences of x over 1 to 16 samples | derivatives without a filter's lag |
| 34 to 41 | friction with speed (Stribeck, quadratic) and place, X^2, X^3 | stiffening, tapering walls |

Differences of several spans let least squares choose between noise and lag, where a filter fixes both.

The stops' radii are powers of two of a metre: when the range doubles, one new stop takes the slot of the
smallest, and the others keep their meaning. They, the range and the fastest speed follow the median of three
positions: a laser's glitch of one sample would change all of them.

A position over ten times as far away as the fastest speed leads is replaced by the last one, until the next
position confirms it. If it is farther away than the range, a new piece begins.

References: Visintin, Differential Models of Hysteresis (1994), stop operator; Armstrong-Helouvry, Dupont and
Canudas de Wit, Automatica 30(7), 1994; Fung, Biomechanics (1993), relaxation.
"""

from typing import Annotated, Protocol

import numpy as np

from forefeel.common.kernels.record import Array

STOPS = 8
SPANS = (1, 2, 4, 8, 16)
RELAXATIONS_S = (0.1, 1.0, 10.0)

FIRST_STOP = 5
FIRST_RELAXATION = FIRST_STOP + STOPS
FIRST_DIFFERENCE = FIRST_RELAXATION + 2 * len(RELAXATIONS_S)
FIRST_NONLINEAR = FIRST_DIFFERENCE + 3 * len(SPANS)
COUNT = FIRST_NONLINEAR + 8

RING = 8192
"""Samples of motion that wait for their forces: 8 s at 1 kHz."""

NO_OCTAVE = -9999.0


class Bank(Protocol):
    """Recent motion and its regressors; the values of a sample are at its number modulo `RING`.

    count: samples so far. start: number of the first one since a gap. origin_m: x0, NaN before a median of
    three is known. octave: the range of motion is at most 2^octave m. v, a: smoothed derivatives.
    fastest_m_s: fading. began_m: where the piece began. suspect_m: the last position if it was replaced,
    else NaN. rest_m, moved_s: where and when the motion last got away from `rest_m` by more than the smallest
    stop's radius. restart: 1 if the next sample follows a gap. slow_*: the means of the relaxations.
    periods_s, octaves, since_moved_s: by sample, the period, the octave and the time since `moved_s` then.
    """

    count: float
    start: float
    origin_m: float
    low_m: float
    high_m: float
    octave: float
    v: float
    a: float
    speed2: float
    speed_s: float
    period_s: float
    fastest_m_s: float
    median_m: float
    began_m: float
    suspect_m: float
    rest_m: float
    moved_s: float
    restart: float
    stops_m: Annotated[Array, STOPS]
    radii_m: Annotated[Array, STOPS]
    slow_m: Annotated[Array, len(RELAXATIONS_S)]
    slow_friction: Annotated[Array, len(RELAXATIONS_S)]
    periods_s: Annotated[Array, RING]
    octaves: Annotated[Array, RING]
    since_moved_s: Annotated[Array, RING]
    t_s: Annotated[Array, RING]
    x_m: Annotated[Array, RING]
    phi: Annotated[Array, RING, COUNT]


def begin(bank: np.void) -> None:
    """Initialises a record of zeros as one without samples."""
    bank["octave"] = NO_OCTAVE
    bank["radii_m"] = 1.0
    bank["t_s"] = -1e18
    bank["origin_m"] = bank["suspect_m"] = np.nan
