"""A wall whose stiffness changes with depth."""

import numpy as np

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.offline import Array


class Stiffening(ForceEffect):
    """`f = k2 x^2 + k3 x^3`."""

    name = "stiffening"
    site = "wall"
    parameters = (
        Parameter("quadratic_n_m2", "N/m^2", 0.0, -1e9, 1e9),
        Parameter("cubic_n_m3", "N/m^3", 0.0, -1e12, 1e12),
    )
    reference = "polynomial restoring force, Duffing, Erzwungene Schwingungen, 1918"
    fingerprint = "a curve over position, the same on the way in and out and at any speed"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(x^2, x^3)."""
        square = x * x
        return (square, square * x)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        square = x * x
        return np.stack((square, square * x)).T
