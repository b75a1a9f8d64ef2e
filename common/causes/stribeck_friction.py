"""Dry friction that is larger at rest than in motion."""

from math import exp

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, ForceColumns, Found, MotionGrid, Shape, Values, log_grid
from forefeel.common.causes.direction import direction, directions
from forefeel.common.causes.offline import Array


def _gaussian(motion: MotionGrid, shape: Shape) -> list[Array]:
    s = motion.direction
    return [s, s * np.exp(-((motion.v / shape[0]) ** 2))]


def _exponential(motion: MotionGrid, shape: Shape) -> list[Array]:
    s = motion.direction
    return [s, s * np.exp(-np.abs(motion.v) / shape[0])]


def _speeds(extent: Extent) -> list[Shape]:
    return log_grid(max(0.02 * extent.speed_m_s, 4.0 * extent.speed_band), 0.4 * extent.speed_m_s, 6)


def _two_levels(found: Found) -> Values:
    coulomb_n, more_n = found.coefficients
    return {
        "coulomb_n": coulomb_n, "static_n": coulomb_n + more_n, "stribeck_velocity_m_s": found.shape[0],
    }  # fmt: skip


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
    words = "dry friction that is larger at low speed"
    equation = ("sgn(x') ({coulomb_n} + ({static_n} - {coulomb_n}) exp(-(x'/{stribeck_velocity_m_s})^2))",)
    candidates = (
        ForceColumns(
            signs=(1, 1), columns=_gaussian, grid=_speeds, naming=_two_levels, sizes=("static_n",),
            picture="speed",
        ),
        ForceColumns(
            form="exponential", signs=(1, 1), columns=_exponential, grid=_speeds, naming=_two_levels,
            sizes=("static_n",), picture="speed",
        ),
    )  # fmt: skip

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
