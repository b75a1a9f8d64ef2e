"""Constant offset of the load cell."""

import numpy as np

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.offline import Array


class Bias(ForceEffect):
    """`f = force_n`, also at no load."""

    name = "bias"
    site = "sensor"
    parameters = (Parameter("force_n", "N", 0.0, -1e4, 1e4),)
    reference = "additive offset of the measurement"
    fingerprint = "a constant level that does not depend on motion or time"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(1,)."""
        return (1.0,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.ones((len(t), 1))
