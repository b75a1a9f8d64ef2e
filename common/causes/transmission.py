"""Play between stage and instrument, with the mass on either side."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import exp
from typing import ClassVar

import numpy as np

from forefeel.common.causes.base import MotionEffect, Parameter
from forefeel.common.causes.candidate import (
    Candidate,
    Entry,
    Extent,
    Found,
    MotionGrid,
    Shape,
    Transmission,
    Values,
    entry,
    log_grid,
)
from forefeel.common.causes.numerics import Array, intervals_s, lazy_kernel
from forefeel.common.causes.wall import MassDamperSpring


def behind(motion: MotionGrid, effect: MotionEffect) -> MotionGrid:
    """The instrument's motion behind an effect, which begins anew in each piece."""
    m, pieces = motion, motion.pieces
    parts = [effect.path(m.t[p], m.x[p], m.v[p], m.a[p], intervals_s(m.t[p])) for p in pieces]
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
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("width_m", "m", 0.0, 0.0, 1e6, linear=False),)
    reference = "Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989, the play operator"
    fingerprint = "after each reversal the force stands still over a constant width of the position"
    words = "play between stage and instrument"
    remedy = "tighten what clamps the instrument to the stage"
    equation: ClassVar[tuple[str, ...]] = ("x behind a play of {width_m} m",)
    candidates: ClassVar[Sequence[Candidate]] = (
        Transmission(
            shapes=("width_m",), moved=lambda motion, shape: behind(motion, Backlash(width_m=shape[0])),
            grid=widths, sizes=("width_m",), picture="reversal",
        ),
    )  # fmt: skip

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

    def path(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> tuple[Array, Array, Array]:
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


HELD_S = 1e9
"""Settling of an instrument that friction holds where it is: longer than any recording."""
_SHARES = 0.02, 0.06, 0.2  # of the stroke: widths that are tried first; chosen
_RESTS = tuple(np.linspace(0.1, 0.9, 7).tolist())  # of the range of positions; chosen
_SETTLINGS_S = 0.03, 0.2  # s, damping over stiffness of tissue and vessels; chosen


def _loose(motion: MotionGrid, shape: Shape) -> MotionGrid:
    width_m, rest_m, settling_s = shape
    effect = Play(width_m=max(width_m, 0.0), rest_position_m=rest_m, settling_s=max(settling_s, 0.0))
    return behind(motion, effect)


def _loose_shapes(extent: Extent) -> list[Shape]:
    low_m, range_m = extent.low_m, extent.range_m
    points = product(_SHARES, _RESTS, _SETTLINGS_S)
    return [(width * extent.stroke_m, low_m + rest * range_m, settling) for width, rest, settling in points]


def _named(found: Found) -> Values:
    width_m, rest_m, settling_s = found.shape
    (behind_kg,) = map(float, found.coefficients)
    return {"width_m": width_m, "rest_position_m": rest_m, "settling_s": settling_s, "behind_kg": behind_kg}


def _with_mass_behind(found: Found) -> list[Entry]:
    values = _named(found)
    mass = {"mass_kg": values["behind_kg"], "damping_n_s_m": 0.0, "stiffness_n_m": 0.0}
    return [entry(Play, values), entry(MassDamperSpring, mass)]


class Play(Backlash):
    """As `backlash`, but the mass moves with the stage: only what resists is behind the gap.

    Within the gap friction holds the instrument, or, with a settling_s below HELD_S, the tissue's spring
    takes it to rest_position_m: `y' = -(y - rest) / settling`, settling = damping / stiffness. It then lies
    against the side from which it is pressed, and no force is felt while it crosses; a part of the mass may
    be behind the gap.

    In a model.yaml the mass on the stage is a `mass_damper_spring` of its own at the site `sensor`.
    """

    name = "play"
    parameters = (
        *Backlash.parameters,
        Parameter("rest_position_m", "m", 0.0, -1e6, 1e6, linear=False),
        Parameter("settling_s", "s", HELD_S, 0.0, HELD_S, linear=False),
    )
    fingerprint = (
        "after each reversal the force of the contact stands still over a constant width of the position, "
        "while the mass is felt at once; or it is zero over that width where its sign changes"
    )
    words = "play between the moving mass and the contact"
    remedy = "tighten what holds the instrument behind the moving mass"
    equation = (
        "x but for the mass behind a play of {width_m} m, loose about {rest_position_m} m",
        "x but for the mass behind a play of {width_m} m",
    )
    candidates = (
        Transmission(
            shapes=("width_m",), moved=lambda motion, shape: behind(motion, Play(width_m=shape[0])),
            grid=widths, sizes=("width_m",), mass_site="sensor", picture="reversal",
        ),
        Transmission(
            form="loose", shapes=("width_m", "rest_position_m", "settling_s"), sizes=("width_m",),
            coefficients=("behind_kg",), signs=(1,), moved=_loose, grid=_loose_shapes, logarithmic=False,
            mass_site="sensor", naming=_named, making=_with_mass_behind, costly=True, picture="position",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        super()._configure()
        self._rest, self._settling_s = self.values["rest_position_m"], self.values["settling_s"]

    def transform(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, float, float]:
        """The instrument's motion: the stage's own while it pushes or pulls, towards rest inside the gap."""
        if self._settling_s >= HELD_S or self._half == 0.0:
            return super().transform(t, x, v, a, dt)
        low, high = x - self._half, x + self._half
        if self._y is None:
            self._y = min(max(self._rest, low), high)
        away = (self._y - self._rest) * (exp(-dt / self._settling_s) if self._settling_s > 0.0 else 0.0)
        free = self._rest + away
        self._y = min(max(free, low), high)
        if self._y != free:
            return self._y, v, a
        rate = away / self._settling_s if away else 0.0
        return self._y, -rate, rate / self._settling_s if away else 0.0

    def path(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> tuple[Array, Array, Array]:
        if self._settling_s >= HELD_S or self._half == 0.0:
            return super().path(t, x, v, a, dt)
        decay = np.exp(-dt / self._settling_s) if self._settling_s > 0.0 else np.zeros_like(dt)
        y, carried = _loose_play(x, self._half, self._rest, decay)
        rate = (y - self._rest) / self._settling_s if self._settling_s > 0.0 else np.zeros_like(y)
        jerk = rate / self._settling_s if self._settling_s > 0.0 else np.zeros_like(y)
        return y, np.where(carried > 0.0, v, -rate), np.where(carried > 0.0, a, jerk)


@lazy_kernel
def _loose_play(x: Array, half: float, rest: float, decay: Array) -> tuple[Array, Array]:
    y, carried = np.empty_like(x), np.zeros_like(x)
    value = min(max(rest, x[0] - half), x[0] + half) if len(x) else rest
    for i in range(len(x)):
        free = rest + (value - rest) * decay[i]
        value = min(max(free, x[i] - half), x[i] + half)
        carried[i] = 0.0 if value == free else 1.0
        y[i] = value
    return y, carried
