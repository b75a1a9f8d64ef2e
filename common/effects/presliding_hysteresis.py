"""Friction that builds up over a distance after each reversal."""

from collections.abc import Sequence
from math import exp

import numpy as np

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.offline import Array, lazy_kernel


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
