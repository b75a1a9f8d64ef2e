"""Friction that builds up over a distance after each reversal."""

from collections.abc import Sequence
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
from forefeel.common.causes.offline import Array, lazy_kernel


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


def _lengths(extent: Extent) -> list[Shape]:
    return log_grid(0.003 * extent.stroke_m, 0.7 * extent.stroke_m, 10)


def _pairs(extent: Extent) -> list[Shape]:
    return two(log_grid(0.003 * extent.stroke_m, 0.7 * extent.stroke_m, 5))


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
        Parameter("stiffness_n_m", "N/m", 50.0, 1e-3, 1e9, linear=False),
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
            form="two", signs=(1, 1), columns=_elements, grid=_pairs, naming=_forces, sizes=("force_n",),
            making=_each, picture="reversal",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._per_metre = self.values["stiffness_n_m"] / self.values["force_n"]

    def reset(self) -> None:
        """Unloaded: no friction until the next motion."""
        self._u = 0.0

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(u,), between -1 and 1."""
        if v > 0.0:
            self._u = 1.0 - (1.0 - self._u) * exp(-self._per_metre * v * dt)
        elif v < 0.0:
            self._u = (1.0 + self._u) * exp(self._per_metre * v * dt) - 1.0
        return (self._u,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        decay = np.exp(-self._per_metre * np.abs(v) * dt)
        return _saturating(np.sign(v), decay)[:, None]

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """The stiffness goes with the force: a linear fit keeps the presliding length."""
        (force_n,) = map(float, coefficients)
        return {"force_n": force_n, "stiffness_n_m": force_n * self._per_metre}


@lazy_kernel
def _saturating(s: Array, decay: Array) -> Array:
    u = np.empty_like(s)
    value = 0.0
    for i in range(len(s)):
        if s[i] != 0.0:
            value = s[i] - (s[i] - value) * decay[i]
        u[i] = value
    return u
