"""Tissue or wall that changes at an instant: a puncture, a release, a branch of the vessel."""

from collections.abc import Sequence

import numpy as np

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.offline import Array


class StiffnessChange(ForceEffect):
    """From `time_s` on the wall's stiffness is `ratio` times what it was.

    An effect adds a force, so this is what the change adds: `f = stiffness_n_m (ratio - 1) (x - x0)` from
    `time_s` on, where stiffness_n_m repeats the wall's stiffness before the change and x0 = rest_position_m
    is where its spring is relaxed. t counts from the caller's own zero.
    """

    name = "stiffness_change"
    site = "wall"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 1.0, 1e-9, 1e9),
        Parameter("time_s", "s", 0.0, -1e9, 1e9, linear=False),
        Parameter("ratio", "", 1.0, 0.0, 1e3, linear=False),
        Parameter("rest_position_m", "m", 0.0, -1e3, 1e3, linear=False),
    )
    reference = "spring with a step in its stiffness; punctures: Okamura et al., IEEE T-BME 51(10), 2004"
    fingerprint = "nothing up to an instant, proportional to position from then on"

    def _configure(self) -> None:
        self._time_s, self._rest_m = self.values["time_s"], self.values["rest_position_m"]
        self._more = self.values["ratio"] - 1.0

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """((ratio - 1) (x - x0) from time_s on,)."""
        return (self._more * (x - self._rest_m) if t >= self._time_s else 0.0,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return np.where(t >= self._time_s, self._more * (x - self._rest_m), 0.0)[:, None]

    def span(self, t: Array, x: Array, v: Array, a: Array, dt: Array | None = None) -> Array:
        """(x, 1) from time_s on, shape (n, 2)."""
        after = t >= self._time_s
        return np.stack((np.where(after, x, 0.0), after.astype(np.float64))).T

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Ratio and rest position, given that `stiffness_n_m` is the wall's."""
        change_n_m, level_n = map(float, coefficients)
        found = {**self.values, "ratio": 1.0 + change_n_m / self.values["stiffness_n_m"]}
        if change_n_m != 0.0:
            found["rest_position_m"] = -level_n / change_n_m
        return found

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        """The instant: the ratio is linear in the span."""
        return ("time_s",)
