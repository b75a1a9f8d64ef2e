"""Dry friction, its level may differ by direction."""

import numpy as np

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.direction import direction, directions
from forefeel.common.effects.offline import Array


class CoulombFriction(ForceEffect):
    """`f = forward_n` while inserting, `-backward_n` while retracting; `force_n` sets both.

    The sign is that of `direction`: continuous within 10 um/s of rest, zero at rest.
    """

    name = "coulomb_friction"
    site = "shaft"
    parameters = (
        Parameter("forward_n", "N", 0.0, 0.0, 1e4),
        Parameter("backward_n", "N", 0.0, 0.0, 1e4),
    )
    shorthands = {"force_n": ("forward_n", "backward_n")}  # noqa: RUF012 - a ClassVar of the base
    reference = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994"
    fingerprint = "two levels by the sign of the velocity: a jump at each reversal, no growth with speed"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(max(s, 0), min(s, 0)) with s the direction."""
        s = direction(v)
        return (s, 0.0) if s > 0.0 else (0.0, s)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        s = directions(v)
        return np.stack((np.maximum(s, 0.0), np.minimum(s, 0.0))).T
