"""Friction along a bent shaft: it multiplies the tip's force."""

from math import copysign, exp

import numpy as np

from forefeel.common.causes.base import FactorEffect, Parameter
from forefeel.common.causes.candidate import Extent, Modulation, MotionGrid, Shape, log_grid
from forefeel.common.causes.direction import direction, directions
from forefeel.common.causes.offline import Array


def _more(motion: MotionGrid, shape: Shape) -> Array:
    return np.asarray(np.exp(shape[0] * motion.direction))


def _wraps(_extent: Extent) -> list[Shape]:
    return log_grid(0.03, 1.5, 9)


class Capstan(FactorEffect):
    """`F = F_tip exp(wrap s)`: against its motion the stage feels more than the tip, along with it less.

    wrap = wrap_rad is the coefficient of friction times the angle by which the shaft is wrapped; s is the
    direction of the motion, see `direction`, by the sign of F_tip. All that acts on shaft and wall is
    multiplied. A diagnosis takes the tip to push throughout.
    """

    name = "capstan"
    parameters = (Parameter("wrap_rad", "rad", 0.0, 0.0, 10.0, linear=False),)
    reference = "capstan (Euler-Eytelwein) equation"
    fingerprint = (
        "a jump at each reversal that is everywhere the same share of the force: it opens with depth"
    )
    words = "friction along the bent shaft that multiplies the tip's force"
    equation = ("all but the bias times exp({wrap_rad} sgn(x'))",)
    candidates = (
        Modulation(shapes=("wrap_rad",), sizes=("wrap_rad",), factor=_more, grid=_wraps, picture="direction"),
    )

    def factor(self, v: float, force_n: float) -> float:
        """exp(wrap s)."""
        return exp(self.values["wrap_rad"] * direction(v) * copysign(1.0, force_n))

    def factors(self, v: Array, force_n: Array) -> Array:
        """exp(wrap s) at each instant."""
        return np.asarray(np.exp(self.values["wrap_rad"] * directions(v) * np.copysign(1.0, force_n)))
