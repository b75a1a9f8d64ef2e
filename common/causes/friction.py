"""Dry friction along the shaft: Coulomb, Stribeck, presliding, growing with depth; its direction."""

from math import exp

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import (
    Entry,
    Extent,
    ForceColumns,
    Found,
    MotionGrid,
    Shape,
    Values,
    entry,
    log_grid,
    two,
)
from forefeel.common.causes.numerics import Array, lazy_kernel

# m/s, half the width of the linear band; chosen, not measured: a wider one makes slow friction viscous, a
# narrower one lets it chatter where a servo comes to rest
BAND_M_S = 1e-5
BREAKAWAY = Parameter("breakaway_m", "m", 0.0, 0.0, 1e6, linear=False)
"""Distance over which friction goes from rest to its full size; 0 where it has it at once."""
BAND = Parameter("band_m_s", "m/s", BAND_M_S, BAND_M_S, 1e5, linear=False)
"""Half the width of the linear band; wider than by default where the speed itself is not known so well."""
# of the stroke, and how many are tried; chosen: a refined one ends where presliding_hysteresis begins
_SHORTEST, _LONGEST, _LENGTHS = 1e-5, 6e-4, 4


def direction(v: float, band_m_s: float = BAND_M_S) -> float:
    """sign(v), exact beyond the band, by default 10 um/s, and linear in v inside.

    The band keeps friction from chattering where a servo comes to rest, the usual regularisation of Coulomb's
    law (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994).
    """
    if v >= band_m_s:
        return 1.0
    if v <= -band_m_s:
        return -1.0
    return v / band_m_s


def directions(v: Array, band_m_s: float = BAND_M_S) -> Array:
    """`direction` of each velocity, shape (n,)."""
    return np.clip(v / band_m_s, -1.0, 1.0)


def wound(motion: MotionGrid, breakaway_m: float) -> Array:
    """The direction along a motion, each piece from rest."""
    steps = [np.diff(motion.x[piece], prepend=motion.x[piece.start]) for piece in motion.pieces]
    return np.concatenate([_wound(step / breakaway_m) for step in steps])


def breakaways_m(extent: Extent) -> list[Shape]:
    return log_grid(_SHORTEST * extent.stroke_m, _LONGEST * extent.stroke_m, _LENGTHS)


class _AlongDirection(ForceEffect):
    """Friction along the direction s of the motion: `direction(v)`; with a breakaway distance L the state
    `s <- clip(s + dx / L, -1, 1)` of a spring in series with the friction (Prandtl, ZAMM 8(2), 1928): the
    stiffness of load cell, holder and asperities.
    """

    def _configure(self) -> None:
        self._breakaway_m, self._band_m_s = self.values["breakaway_m"], self.values.get(BAND.name, BAND_M_S)

    def reset(self) -> None:
        self._s = 0.0

    @property
    def remembers(self) -> bool:
        return self._breakaway_m > 0.0

    def _after(self, v: float, dt: float) -> float:
        """s in -1 to 1, after a step of dt in s at v in m/s."""
        if self._breakaway_m <= 0.0:
            return direction(v, self._band_m_s)
        self._s = min(max(self._s + v * dt / self._breakaway_m, -1.0), 1.0)
        return self._s

    def _over(self, v: Array, dt: Array) -> Array:
        """s of a whole recording from rest, shape (n,)."""
        if self._breakaway_m <= 0.0:
            return directions(v, self._band_m_s)
        return _wound(v * dt / self._breakaway_m)


@lazy_kernel
def _wound(steps: Array) -> Array:
    wound = np.empty_like(steps)
    s = 0.0
    for i in range(len(steps)):
        s = min(max(s + steps[i], -1.0), 1.0)
        wound[i] = s
    return wound


def _by_direction(found: Found) -> Values:
    forward_n, backward_n = found.coefficients
    return {"force_n": 0.5 * (forward_n + backward_n), "forward_n": forward_n, "backward_n": backward_n}


class CoulombFriction(_AlongDirection):
    """`f = forward_n` while inserting, `-backward_n` while retracting; `force_n` sets both."""

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
        ForceColumns(
            coefficients=("force_n",), signs=(1,), columns=lambda motion, _: [motion.direction],
            picture="speed",
        ),
        ForceColumns(
            form="asymmetric", naming=_by_direction, sizes=("force_n",), signs=(1, 1),
            columns=lambda m, _: [np.maximum(m.direction, 0.0), np.minimum(m.direction, 0.0)],
            picture="speed",
        ),
        ForceColumns(
            form="elastic", coefficients=("force_n",), shapes=("breakaway_m",), signs=(1,),
            columns=lambda motion, shape: [wound(motion, *shape)], grid=breakaways_m, costly=True,
            picture="speed",
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(max(s, 0), min(s, 0)) with s the direction."""
        s = self._after(v, dt)
        return (s, 0.0) if s > 0.0 else (0.0, s)

    def columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        s = self._over(v, dt)
        return np.stack((np.maximum(s, 0.0), np.minimum(s, 0.0))).T


def _gaussian(motion: MotionGrid, shape: Shape) -> list[Array]:
    """Of a velocity, and of a breakaway distance where there is one."""
    s = wound(motion, *shape[1:]) if shape[1:] else motion.direction
    return [s, s * np.exp(-((motion.v / shape[0]) ** 2))]


def _speeds(extent: Extent) -> list[Shape]:
    return log_grid(max(0.02 * extent.speed_m_s, 4.0 * extent.speed_band), 0.4 * extent.speed_m_s, 6)


def _two_levels(found: Found) -> Values:
    coulomb_n, more_n = found.coefficients
    shapes = zip(("stribeck_velocity_m_s", "breakaway_m"), found.shape, strict=False)
    return {"coulomb_n": coulomb_n, "static_n": coulomb_n + more_n, **dict(shapes)}


class StribeckFriction(_AlongDirection):
    """`f = (Fc + (Fs - Fc) exp(-(v / vs)^2)) sign(v)`.

    Fc = coulomb_n, Fs = static_n, vs = stribeck_velocity_m_s. Linear in Fc and Fs. With
    Fs = Fc it is `coulomb_friction`.
    """

    name = "stribeck_friction"
    site = "shaft"
    parameters = (
        Parameter("coulomb_n", "N", 0.0, 0.0, 1e4),
        Parameter("static_n", "N", 0.0, 0.0, 1e4),
        Parameter("stribeck_velocity_m_s", "m/s", 0.005, 1e-9, 1e5, linear=False),
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
            form="exponential", signs=(1, 1), grid=_speeds, naming=_two_levels, sizes=("static_n",),
            columns=lambda m, shape: [m.direction, m.direction * np.exp(-np.abs(m.v) / shape[0])],
            picture="speed",
        ),
        ForceColumns(
            form="elastic", signs=(1, 1), columns=_gaussian,
            grid=lambda e: [(*speed, *length) for speed in _speeds(e)[::2] for length in breakaways_m(e)],
            naming=_two_levels, sizes=("static_n",), costly=True, picture="speed",
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(s (1 - e), s e) with s the direction and e = exp(-(v / vs)^2)."""
        s, share = self._after(v, dt), v / self.values["stribeck_velocity_m_s"]
        static = s * exp(-share * share)
        return (s - static, static)

    def columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        s, share = self._over(v, dt), v / self.values["stribeck_velocity_m_s"]
        static = s * np.exp(-share * share)
        return np.stack((s - static, static)).T


def _deflection(motion: MotionGrid, shape: Shape) -> list[Array]:
    effect = PreslidingHysteresis(force_n=1.0, stiffness_n_m=1.0 / shape[0])
    u = np.empty_like(motion.x)
    for piece in motion.pieces:
        x = motion.x[piece]
        step = np.diff(x, prepend=x[:1])
        u[piece] = effect.columns(motion.t[piece], x, step, step, np.ones_like(x))[:, 0]
    return [u]


def _bristles(motion: MotionGrid, shape: Shape) -> list[Array]:
    """LuGre: the bristles' deflection and its rate."""
    (u,) = _deflection(motion, shape)
    rate = np.concatenate([np.gradient(u[p], motion.t[p]) for p in motion.pieces])
    return [u, rate]


def _elements(motion: MotionGrid, shape: Shape) -> list[Array]:
    """Two elements of a generalised Maxwell slip (Al-Bender, Lampaert, Swevers, IEEE T-AC 50(11), 2005)."""
    return _deflection(motion, shape[:1]) + _deflection(motion, shape[1:])


def _lengths(extent: Extent, count: int = 10) -> list[Shape]:
    return log_grid(0.003 * extent.stroke_m, 0.7 * extent.stroke_m, count)


def _force(found: Found) -> Values:
    force_n = found.coefficients[0]
    return {"force_n": force_n, "stiffness_n_m": force_n / found.shape[0]}


def _forces(found: Found) -> Values:
    (short_n, long_n), (short_m, long_m) = found.coefficients, found.shape
    return {"force_n": short_n + long_n, "stiffness_n_m": short_n / short_m + long_n / long_m}


def _each(found: Found) -> list[Entry]:
    return [
        entry(PreslidingHysteresis, {"force_n": force_n, "stiffness_n_m": force_n / length_m})
        for force_n, length_m in zip(found.coefficients, found.shape, strict=True)
    ]


class PreslidingHysteresis(ForceEffect):
    """Dahl's model `df/dx = sigma (1 - (f / Fc) sign(v))`, Fc = force_n, sigma = stiffness_n_m.

    Rate independent. With u = f / Fc and travel d = |v| dt in direction s, exact at constant velocity:
    `u(t + dt) = s - (s - u(t)) exp(-sigma d / Fc)`. u depends on the presliding length Fc / sigma only, so
    the force is linear in `force_n` **at that length**: a fit of `force_n` alone scales the stiffness too.
    """

    name = "presliding_hysteresis"
    site = "shaft"
    parameters = (
        Parameter("force_n", "N", 0.01, 1e-6, 1e4),
        Parameter("stiffness_n_m", "N/m", 50.0, 1e-6, 1e12, linear=False),
    )
    reference = "Dahl, A Solid Friction Model, Aerospace Corporation TOR-0158(3107-18)-1, 1968"
    fingerprint = "a curve over the distance since the last reversal that saturates, the same at any speed"
    words = "friction that builds up over a distance after each reversal"
    equation = ("{force_n} u; {force_n} du/dx = {stiffness_n_m} (1 - u sgn(x'))",)
    candidates = (
        ForceColumns(
            signs=(1,), columns=_deflection, grid=_lengths, naming=_force, sizes=("force_n",),
            picture="reversal",
        ),
        ForceColumns(
            form="bristles", signs=(1, 1), columns=_bristles, grid=_lengths, naming=_force,
            sizes=("force_n",), picture="reversal",
        ),
        ForceColumns(
            form="two", signs=(1, 1), columns=_elements, grid=lambda extent: two(_lengths(extent, 5)),
            naming=_forces, sizes=("force_n",), making=_each, picture="reversal",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._per_metre = self.values["stiffness_n_m"] / self.values["force_n"]

    def reset(self) -> None:
        self._u = 0.0

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(u,), between -1 and 1."""
        if v > 0.0:
            self._u = 1.0 - (1.0 - self._u) * exp(-self._per_metre * v * dt)
        elif v < 0.0:
            self._u = (1.0 + self._u) * exp(self._per_metre * v * dt) - 1.0
        return (self._u,)

    def columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        decay = np.exp(-self._per_metre * np.abs(v) * dt)
        return _saturating(np.sign(v), decay)[:, None]


@lazy_kernel
def _saturating(s: Array, decay: Array) -> Array:
    u = np.empty_like(s)
    value = 0.0
    for i in range(len(s)):
        if s[i] != 0.0:
            value = s[i] - (s[i] - value) * decay[i]
        u[i] = value
    return u


class PositionDependentFriction(_AlongDirection):
    """`f = force_per_length_n_m max(x, 0) sign(v)`: the capstan's law to first order in the length."""

    name = "position_dependent_friction"
    site = "wall"
    parameters = (Parameter("force_per_length_n_m", "N/m", 0.0, 0.0, 1e6), BREAKAWAY, BAND)
    reference = "capstan (Euler-Eytelwein) equation, linearised in the length of contact"
    fingerprint = "a jump at each reversal that is larger the deeper the instrument is"
    words = "friction that grows with the inserted length"
    equation = (
        "{force_per_length_n_m} max(x, 0) s; ds = dx/{breakaway_m} within -1 to 1",
        "{force_per_length_n_m} max(x, 0) sgn(x')",
    )
    candidates = (
        ForceColumns(
            coefficients=("force_per_length_n_m",), signs=(1,),
            columns=lambda motion, _: [motion.depth * motion.direction], at_wall=True, picture="direction",
        ),
        ForceColumns(
            form="elastic", coefficients=("force_per_length_n_m",), shapes=("breakaway_m",), signs=(1,),
            columns=lambda motion, shape: [motion.depth * wound(motion, *shape)], grid=breakaways_m,
            at_wall=True, costly=True, picture="direction",
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(inserted length times direction,)."""
        return (max(x, 0.0) * self._after(v, dt),)

    def columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return (np.maximum(x, 0.0) * self._over(v, dt))[:, None]
