"""Constant offset of the load cell."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import ReadingColumns, Shape
from forefeel.common.causes.offline import Array


def _constant(t: Array, _shape: Shape) -> Array:
    return np.ones((len(t), 1))


class Bias(ForceEffect):
    """`f = force_n`, also at no load."""

    name = "bias"
    site = "sensor"
    parameters = (Parameter("force_n", "N", 0.0, -1e4, 1e4),)
    reference = "additive offset of the measurement"
    fingerprint = "a constant level that does not depend on motion or time"
    words = "a constant offset of the load cell"
    equation = ("{force_n}",)
    candidates = (
        ReadingColumns(
            coefficients=("force_n",), signs=(0,), columns=_constant, least_score=4.0, least_ratio=1.0
        ),
    )

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(1,)."""
        return (1.0,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.ones((len(t), 1))
