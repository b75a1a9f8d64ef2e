"""Constant offset of the load cell."""

from common.effects.base import ForceEffect, Parameter


class Bias(ForceEffect):
    """`f = force_n`, also at no load."""

    name = "bias"
    site = "sensor"
    parameters = (Parameter("force_n", "N", 0.0, -1e4, 1e4),)
    reference = "additive offset of the measurement"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(1,)."""
        return (1.0,)
