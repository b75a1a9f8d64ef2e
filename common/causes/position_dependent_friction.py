"""Friction that grows with the inserted length."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import ForceColumns, MotionGrid, Shape
from forefeel.common.causes.direction import direction, directions
from forefeel.common.causes.offline import Array


def _deep(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [motion.depth * motion.direction]


class PositionDependentFriction(ForceEffect):
    """`f = force_per_length_n_m max(x, 0) sign(v)`: the capstan's law to first order in the length.

    The sign is that of `direction`: continuous within 10 um/s of rest, zero at rest.
    """

    name = "position_dependent_friction"
    site = "wall"
    parameters = (Parameter("force_per_length_n_m", "N/m", 0.0, 0.0, 1e6),)
    reference = "capstan (Euler-Eytelwein) equation, linearised in the length of contact"
    fingerprint = "a jump at each reversal that is larger the deeper the instrument is"
    words = "friction that grows with the inserted length"
    equation = ("{force_per_length_n_m} max(x, 0) sgn(x')",)
    candidates = (
        ForceColumns(
            coefficients=("force_per_length_n_m",), signs=(1,), columns=_deep, at_wall=True,
            picture="direction",
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(inserted length times direction,)."""
        return (x * direction(v) if x > 0.0 else 0.0,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return (np.maximum(x, 0.0) * directions(v))[:, None]
