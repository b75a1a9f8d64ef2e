"""Damping of a soft wall that grows with the depth."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import ForceColumns, MotionGrid, Shape
from forefeel.common.causes.offline import Array


def _deep(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [motion.depth * motion.v]


class HuntCrossleyDamping(ForceEffect):
    """`f = damping_n_s_m2 max(x, 0) v`: without a jump of force where the contact begins.

    The damping part of Hunt and Crossley's law for a linear spring, whose elastic part the model has already.
    """

    name = "hunt_crossley_damping"
    site = "wall"
    parameters = (Parameter("damping_n_s_m2", "N s/m^2", 0.0, 0.0, 1e9),)
    reference = "Hunt and Crossley, Coefficient of Restitution Interpreted as Damping, J. Appl. Mech. 42(2)"
    fingerprint = "proportional to speed, and more so the deeper: a loop that widens with depth and speed"
    words = "damping that grows with depth"
    equation = ("{damping_n_s_m2} max(x, 0) x'",)
    candidates = (
        ForceColumns(
            coefficients=("damping_n_s_m2",), signs=(1,), columns=_deep, at_wall=True, picture="depth"
        ),
    )

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(depth times velocity,)."""
        return (x * v if x > 0.0 else 0.0,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return (np.maximum(x, 0.0) * v)[:, None]
