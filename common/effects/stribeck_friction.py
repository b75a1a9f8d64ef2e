"""Dry friction that is larger at rest than in motion."""

from math import exp

import numpy as np

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.direction import direction, directions
from forefeel.common.effects.offline import Array


class StribeckFriction(ForceEffect):
    """`f = (Fc + (Fs - Fc) exp(-(v / vs)^2)) sign(v)`.

    Fc = coulomb_n, Fs = static_n, vs = stribeck_velocity_m_s. Linear in Fc and Fs. The sign is that of
    `direction`: continuous within 10 um/s of rest, zero at rest. With Fs = Fc it is `coulomb_friction`.
    """

    name = "stribeck_friction"
    site = "shaft"
    parameters = (
        Parameter("coulomb_n", "N", 0.0, 0.0, 1e4),
        Parameter("static_n", "N", 0.0, 0.0, 1e4),
        Parameter("stribeck_velocity_m_s", "m/s", 0.005, 1e-6, 1e2, linear=False),
    )
    reference = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994, Gaussian form"
    fingerprint = "two levels by the sign of the velocity with a peak at low speed that falls with speed"

    def _configure(self) -> None:
        self._velocity_m_s = self.values["stribeck_velocity_m_s"]

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(s (1 - e), s e) with s the direction and e = exp(-(v / vs)^2)."""
        s, share = direction(v), v / self._velocity_m_s
        static = s * exp(-share * share)
        return (s - static, static)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        s, share = directions(v), v / self._velocity_m_s
        static = s * np.exp(-share * share)
        return np.stack((s - static, static)).T
