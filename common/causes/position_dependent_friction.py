"""Friction that grows with the inserted length."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, ForceColumns, MotionGrid, Shape
from forefeel.common.causes.direction import BREAKAWAY, Direction, breakaways_m, wound
from forefeel.common.causes.offline import Array


def _deep(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [motion.depth * motion.direction]


def _elastic(motion: MotionGrid, shape: Shape) -> list[Array]:
    return [motion.depth * wound(motion, shape[0])]


def _lengths(extent: Extent) -> list[Shape]:
    return [(length_m,) for length_m in breakaways_m(extent)]


class PositionDependentFriction(ForceEffect):
    """`f = force_per_length_n_m max(x, 0) sign(v)`: the capstan's law to first order in the length.

    The sign is that of `Direction`: continuous within 10 um/s of rest and zero at rest, or built up over
    `breakaway_m`.
    """

    name = "position_dependent_friction"
    site = "wall"
    parameters = (Parameter("force_per_length_n_m", "N/m", 0.0, 0.0, 1e6), BREAKAWAY)
    reference = "capstan (Euler-Eytelwein) equation, linearised in the length of contact"
    fingerprint = "a jump at each reversal that is larger the deeper the instrument is"
    words = "friction that grows with the inserted length"
    equation = (
        "{force_per_length_n_m} max(x, 0) s; ds = dx/{breakaway_m} within -1 to 1",
        "{force_per_length_n_m} max(x, 0) sgn(x')",
    )
    candidates = (
        ForceColumns(
            coefficients=("force_per_length_n_m",), signs=(1,), columns=_deep, at_wall=True,
            picture="direction",
        ),
        ForceColumns(
            form="elastic", coefficients=("force_per_length_n_m",), shapes=("breakaway_m",), signs=(1,),
            columns=_elastic, grid=_lengths, at_wall=True, costly=True, picture="direction",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._direction = Direction(self.values["breakaway_m"])

    def reset(self) -> None:
        """No friction until the next motion."""
        self._direction.reset()

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(inserted length times direction,)."""
        return (max(x, 0.0) * self._direction.after(v, dt),)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return (np.maximum(x, 0.0) * self._direction.over(v, dt))[:, None]
