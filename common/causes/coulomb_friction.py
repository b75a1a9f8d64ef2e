"""Dry friction, its level may differ by direction."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, ForceColumns, Found, MotionGrid, Shape, Values
from forefeel.common.causes.direction import BREAKAWAY, Direction, breakaways_m, wound
from forefeel.common.causes.offline import Array


def _level(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [motion.direction]


def _levels(motion: MotionGrid, _shape: Shape) -> list[Array]:
    s = motion.direction
    return [np.maximum(s, 0.0), np.minimum(s, 0.0)]


def _elastic(motion: MotionGrid, shape: Shape) -> list[Array]:
    return [wound(motion, shape[0])]


def _lengths(extent: Extent) -> list[Shape]:
    return [(length_m,) for length_m in breakaways_m(extent)]


def _by_direction(found: Found) -> Values:
    forward_n, backward_n = found.coefficients
    return {"force_n": 0.5 * (forward_n + backward_n), "forward_n": forward_n, "backward_n": backward_n}


class CoulombFriction(ForceEffect):
    """`f = forward_n` while inserting, `-backward_n` while retracting; `force_n` sets both.

    The sign is that of `Direction`: continuous within 10 um/s of rest and zero at rest, or built up over
    `breakaway_m`.
    """

    name = "coulomb_friction"
    site = "shaft"
    parameters = (
        Parameter("forward_n", "N", 0.0, 0.0, 1e4),
        Parameter("backward_n", "N", 0.0, 0.0, 1e4),
        BREAKAWAY,
    )
    shorthands = {"force_n": ("forward_n", "backward_n")}  # noqa: RUF012 - a ClassVar of the base
    reference = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994"
    fingerprint = "two levels by the sign of the velocity: a jump at each reversal, no growth with speed"
    words = "dry friction"
    equation = (
        "{force_n} s; ds = dx/{breakaway_m} within -1 to 1",
        "{forward_n} [x' > 0] - {backward_n} [x' < 0]",
        "{force_n} sgn(x')",
    )
    candidates = (
        ForceColumns(coefficients=("force_n",), signs=(1,), columns=_level, picture="speed"),
        ForceColumns(
            form="asymmetric",
            naming=_by_direction,
            sizes=("force_n",),
            signs=(1, 1),
            columns=_levels,
            picture="speed",
        ),
        ForceColumns(
            form="elastic", coefficients=("force_n",), shapes=("breakaway_m",), signs=(1,), columns=_elastic,
            grid=_lengths, costly=True, picture="speed",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._direction = Direction(self.values["breakaway_m"])

    def reset(self) -> None:
        """No friction until the next motion."""
        self._direction.reset()

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(max(s, 0), min(s, 0)) with s the direction."""
        s = self._direction.after(v, dt)
        return (s, 0.0) if s > 0.0 else (0.0, s)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        s = self._direction.over(v, dt)
        return np.stack((np.maximum(s, 0.0), np.minimum(s, 0.0))).T
