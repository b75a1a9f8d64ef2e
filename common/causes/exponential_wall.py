"""A wall of soft tissue, whose force grows exponentially with depth."""

from math import expm1

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.offline import Array

_MOST = 50.0
"""Lengths beyond which the force stays: far outside of any tissue, and of no overflow."""


class ExponentialWall(ForceEffect):
    """`f = exponential_n (exp(x / L) - 1 - x / L)`, L = length_m.

    Fung's law without its linear part, which is the stiffness of `mass_damper_spring`; like that spring it
    acts on both sides of zero unless there is a `contact_loss`. To second and third order in x it is
    `stiffening`.
    """

    name = "exponential_wall"
    site = "wall"
    parameters = (
        Parameter("exponential_n", "N", 0.0, 0.0, 1e4),
        Parameter("length_m", "m", 0.01, 1e-5, 1e2, linear=False),
    )
    reference = "Fung, Elasticity of soft tissues in simple elongation, Am. J. Physiol. 213, 1967"
    fingerprint = "a curve over position that steepens without end, the same on the way in and out"

    def _configure(self) -> None:
        self._length_m = self.values["length_m"]

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(exp(x / L) - 1 - x / L,)."""
        depth = max(min(x / self._length_m, _MOST), -_MOST)
        return (expm1(depth) - depth,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        depth = np.clip(x / self._length_m, -_MOST, _MOST)
        return (np.expm1(depth) - depth)[:, None]
