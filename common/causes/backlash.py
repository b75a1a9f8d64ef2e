"""Play between stage and instrument."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from forefeel.common.causes.base import MotionEffect, Parameter
from forefeel.common.causes.candidate import Candidate, Extent, MotionGrid, Shape, Transmission, log_grid
from forefeel.common.causes.offline import Array, lazy_kernel


def _behind(motion: MotionGrid, shape: Shape) -> MotionGrid:
    return behind(motion, Backlash(width_m=shape[0]))


def behind(motion: MotionGrid, effect: MotionEffect) -> MotionGrid:
    """The instrument's motion behind an effect, which begins anew in each piece."""
    parts = [effect.path(motion.t[p], motion.x[p], motion.v[p], motion.a[p]) for p in motion.pieces]
    x, v, a = (np.concatenate(column) for column in zip(*parts, strict=True))
    return replace(motion, x=x, v=v, a=a)


def widths(extent: Extent) -> list[Shape]:
    """From a two hundredth of the stroke to more than half of it."""
    return log_grid(0.005 * extent.stroke_m, 0.6 * extent.stroke_m, 9)


class Backlash(MotionEffect):
    """The play operator of full width w = width_m: the instrument rests while the stage crosses the gap.

    `y(t + dt) = min(max(y(t), x - w/2), x + w/2)`; without history the stage stands in the middle of the gap.
    """

    name = "backlash"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("width_m", "m", 0.0, 0.0, 1e2, linear=False),)
    reference = "Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989, the play operator"
    fingerprint = "after each reversal the force stands still over a constant width of the position"
    words = "play between stage and instrument"
    equation: ClassVar[tuple[str, ...]] = ("x behind a play of {width_m} m",)
    candidates: ClassVar[Sequence[Candidate]] = (
        Transmission(shapes=("width_m",), moved=_behind, grid=widths, sizes=("width_m",), picture="reversal"),
    )

    def _configure(self) -> None:
        self._half = 0.5 * self.values["width_m"]

    def reset(self) -> None:
        """Forgets where in the gap the stage stands."""
        self._y: float | None = None

    def transform(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, float, float]:
        """The instrument's motion: the stage's own while it pushes or pulls, rest inside the gap."""
        y = x if self._y is None else self._y
        if x - self._half > y:
            y = x - self._half
        elif x + self._half < y:
            y = x + self._half
        elif self._half > 0.0:
            v = a = 0.0
        self._y = y
        return y, v, a

    def _path(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> tuple[Array, Array, Array]:
        if self._half == 0.0:
            return x, v, a
        y, carried = _play(x, self._half)
        return y, v * carried, a * carried


@lazy_kernel
def _play(x: Array, half: float) -> tuple[Array, Array]:
    y, carried = np.empty_like(x), np.zeros_like(x)
    value = x[0] if len(x) else 0.0
    for i in range(len(x)):
        if x[i] - half > value:
            value = x[i] - half
            carried[i] = 1.0
        elif x[i] + half < value:
            value = x[i] + half
            carried[i] = 1.0
        y[i] = value
    return y, carried
