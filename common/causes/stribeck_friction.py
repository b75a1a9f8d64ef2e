"""Dry friction that is larger at rest than in motion."""

from math import exp

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, ForceColumns, Found, MotionGrid, Shape, Values, log_grid
from forefeel.common.causes.direction import BREAKAWAY, Direction, breakaways_m, wound
from forefeel.common.causes.offline import Array


def _gaussian(motion: MotionGrid, shape: Shape) -> list[Array]:
    s = motion.direction
    return [s, s * np.exp(-((motion.v / shape[0]) ** 2))]


def _exponential(motion: MotionGrid, shape: Shape) -> list[Array]:
    s = motion.direction
    return [s, s * np.exp(-np.abs(motion.v) / shape[0])]


def _elastic(motion: MotionGrid, shape: Shape) -> list[Array]:
    s = wound(motion, shape[1])
    return [s, s * np.exp(-((motion.v / shape[0]) ** 2))]


def _speeds(extent: Extent) -> list[Shape]:
    return log_grid(max(0.02 * extent.speed_m_s, 4.0 * extent.speed_band), 0.4 * extent.speed_m_s, 6)


def _speeds_and_lengths(extent: Extent) -> list[Shape]:
    return [(speed_m_s, m) for (speed_m_s,) in _speeds(extent)[::2] for m in breakaways_m(extent)]


def _two_levels(found: Found) -> Values:
    coulomb_n, more_n = found.coefficients
    shapes = zip(("stribeck_velocity_m_s", "breakaway_m"), found.shape, strict=False)
    return {"coulomb_n": coulomb_n, "static_n": coulomb_n + more_n, **dict(shapes)}


class StribeckFriction(ForceEffect):
    """`f = (Fc + (Fs - Fc) exp(-(v / vs)^2)) sign(v)`.

    Fc = coulomb_n, Fs = static_n, vs = stribeck_velocity_m_s. Linear in Fc and Fs. The sign is that of
    `Direction`: continuous within 10 um/s of rest and zero at rest, or built up over `breakaway_m`. With
    Fs = Fc it is `coulomb_friction`.
    """

    name = "stribeck_friction"
    site = "shaft"
    parameters = (
        Parameter("coulomb_n", "N", 0.0, 0.0, 1e4),
        Parameter("static_n", "N", 0.0, 0.0, 1e4),
        Parameter("stribeck_velocity_m_s", "m/s", 0.005, 1e-6, 1e2, linear=False),
        BREAKAWAY,
    )
    reference = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994, Gaussian form"
    fingerprint = "two levels by the sign of the velocity with a peak at low speed that falls with speed"
    words = "dry friction that is larger at low speed"
    equation = (
        "s ({coulomb_n} + ({static_n} - {coulomb_n}) exp(-(x'/{stribeck_velocity_m_s})^2)); "
        "ds = dx/{breakaway_m} within -1 to 1",
        "sgn(x') ({coulomb_n} + ({static_n} - {coulomb_n}) exp(-(x'/{stribeck_velocity_m_s})^2))",
    )
    candidates = (
        ForceColumns(
            signs=(1, 1), columns=_gaussian, grid=_speeds, naming=_two_levels, sizes=("static_n",),
            picture="speed",
        ),
        ForceColumns(
            form="exponential", signs=(1, 1), columns=_exponential, grid=_speeds, naming=_two_levels,
            sizes=("static_n",), picture="speed",
        ),
        ForceColumns(
            form="elastic", signs=(1, 1), columns=_elastic, grid=_speeds_and_lengths, naming=_two_levels,
            sizes=("static_n",), costly=True, picture="speed",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._velocity_m_s = self.values["stribeck_velocity_m_s"]
        self._direction = Direction(self.values["breakaway_m"])

    def reset(self) -> None:
        """No friction until the next motion."""
        self._direction.reset()

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(s (1 - e), s e) with s the direction and e = exp(-(v / vs)^2)."""
        s, share = self._direction.after(v, dt), v / self._velocity_m_s
        static = s * exp(-share * share)
        return (s - static, static)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        s, share = self._direction.over(v, dt), v / self._velocity_m_s
        static = s * np.exp(-share * share)
        return np.stack((s - static, static)).T
