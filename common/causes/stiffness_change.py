"""Tissue or wall that changes at an instant: a puncture, a release, a branch of the vessel."""

from collections.abc import Sequence

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
)
from forefeel.common.causes.offline import Array


def _later(motion: MotionGrid, shape: Shape) -> list[Array]:
    return [motion.x * (motion.t > shape[0])]


def _later_about_rest(motion: MotionGrid, shape: Shape) -> list[Array]:
    after = np.asarray(motion.t > shape[0], dtype=np.float64)
    return [motion.x * after, after]


def _instants(extent: Extent) -> list[Shape]:
    return [(float(t),) for t in np.linspace(0.0, extent.duration_s, 32)[2:-2]]


def _ratio(found: Found) -> Values:
    change, stiffness = found.coefficients[0], found.base[2]
    return {
        "time_s": found.start_s + found.shape[0],
        "ratio": 1.0 + change / stiffness if stiffness else float("inf"),
    }


def _ratio_and_rest(found: Found) -> Values:
    change, level = found.coefficients
    return {**_ratio(found), "rest_position_m": -level / change if change else float("inf")}


def _change(found: Found) -> list[Entry]:
    stiffness = float(max(found.base[2], 1e-9))
    effect = StiffnessChange(stiffness_n_m=stiffness, time_s=found.start_s + found.shape[0])
    change, level = (*map(float, found.coefficients), 0.0)[:2]
    return [entry(StiffnessChange, effect.from_span([change, level]))]


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
    words = "a stiffness that changes at an instant"
    candidates = (
        ForceColumns(
            signs=(0,), columns=_later, logarithmic=False, grid=_instants, at_wall=True, naming=_ratio,
            making=_change,
        ),
        ForceColumns(
            form="rest", signs=(0, 0), columns=_later_about_rest, logarithmic=False, grid=_instants,
            least_score=40.0, least_ratio=1.5,  # a level that steps describes a little of anything slow
            at_wall=True, naming=_ratio_and_rest, making=_change,
        ),
    )  # fmt: skip

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
