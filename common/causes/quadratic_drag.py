"""Drag of a fluid at speeds where inertia rules."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import ForceColumns, MotionGrid, Shape
from forefeel.common.causes.offline import Array


def _square(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [motion.v * np.abs(motion.v)]


class QuadraticDrag(ForceEffect):
    """`f = drag_n_s2_m2 v |v|`."""

    name = "quadratic_drag"
    site = "shaft"
    parameters = (Parameter("drag_n_s2_m2", "N s^2/m^2", 0.0, 0.0, 1e9),)
    reference = "Newton's law of drag, Batchelor, An Introduction to Fluid Dynamics, 1967"
    fingerprint = "odd in the velocity and growing with its square, without a jump at rest"
    words = "drag with the square of the speed"
    equation = ("{drag_n_s2_m2} x' |x'|",)
    candidates = (ForceColumns(coefficients=("drag_n_s2_m2",), signs=(1,), columns=_square, picture="speed"),)

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(v |v|,)."""
        return (v * abs(v),)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return (v * np.abs(v))[:, None]
