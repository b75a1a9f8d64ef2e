"""The direction in which dry friction opposes: the sign of the velocity, or what winds up over a distance."""

import numpy as np

from forefeel.common.causes.base import Parameter
from forefeel.common.causes.candidate import Extent, MotionGrid, log_grid
from forefeel.common.causes.offline import Array, lazy_kernel

# m/s, half the width of the linear band; chosen, not measured: a wider one makes slow friction viscous, a
# narrower one lets it chatter where a servo comes to rest
BAND_M_S = 1e-5
BREAKAWAY = Parameter("breakaway_m", "m", 0.0, 0.0, 1.0, linear=False)
"""Distance over which friction goes from rest to its full size; 0 where it has it at once."""
# of the stroke, and how many are tried; chosen: a refined one ends where presliding_hysteresis begins
_SHORTEST, _LONGEST, _LENGTHS = 1e-5, 6e-4, 4


def direction(v: float) -> float:
    """sign(v), exact beyond 10 um/s and linear in v inside that band.

    The band keeps friction from chattering where a servo comes to rest, the usual regularisation of Coulomb's
    law (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994).
    """
    if v >= BAND_M_S:
        return 1.0
    if v <= -BAND_M_S:
        return -1.0
    return v / BAND_M_S


def directions(v: Array) -> Array:
    """`direction` of each velocity, shape (n,)."""
    return np.clip(v / BAND_M_S, -1.0, 1.0)


class Direction:
    """`direction(v)`; with a breakaway distance L the state `s <- clip(s + dx / L, -1, 1)` of a spring in
    series with the friction (Prandtl, ZAMM 8(2), 1928): the stiffness of load cell, holder and asperities.
    """

    def __init__(self, breakaway_m: float) -> None:
        self._breakaway_m = breakaway_m
        self._s = 0.0

    def reset(self) -> None:
        """Unloaded."""
        self._s = 0.0

    def after(self, v: float, dt: float) -> float:
        """In -1 to 1, after a step of dt in s at v in m/s."""
        if self._breakaway_m <= 0.0:
            return direction(v)
        self._s = min(max(self._s + v * dt / self._breakaway_m, -1.0), 1.0)
        return self._s

    def over(self, v: Array, dt: Array) -> Array:
        """The same of a whole recording from rest, shape (n,)."""
        return directions(v) if self._breakaway_m <= 0.0 else _wound(v * dt / self._breakaway_m)


def wound(motion: MotionGrid, breakaway_m: float) -> Array:
    """The direction along a motion, each piece from rest."""
    steps = [np.diff(motion.x[piece], prepend=motion.x[piece.start]) for piece in motion.pieces]
    return np.concatenate([_wound(step / breakaway_m) for step in steps])


def breakaways_m(extent: Extent) -> list[float]:
    """Distances that are tried."""
    lengths = log_grid(_SHORTEST * extent.stroke_m, _LONGEST * extent.stroke_m, _LENGTHS)
    return [length_m for (length_m,) in lengths]


@lazy_kernel
def _wound(steps: Array) -> Array:
    wound = np.empty_like(steps)
    s = 0.0
    for i in range(len(steps)):
        s = min(max(s + steps[i], -1.0), 1.0)
        wound[i] = s
    return wound
