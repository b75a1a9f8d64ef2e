"""A wall whose stiffness changes with depth."""

from common.effects.base import ForceEffect, Parameter


class Stiffening(ForceEffect):
    """`f = k2 x^2 + k3 x^3`."""

    name = "stiffening"
    site = "wall"
    parameters = (
        Parameter("quadratic_n_m2", "N/m^2", 0.0, -1e9, 1e9),
        Parameter("cubic_n_m3", "N/m^3", 0.0, -1e12, 1e12),
    )
    reference = "polynomial restoring force, Duffing, Erzwungene Schwingungen, 1918"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(x^2, x^3)."""
        square = x * x
        return (square, square * x)
