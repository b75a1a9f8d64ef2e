"""How a diagnosis fits a force effect that does not say so itself, such as one of another distribution.

Its `span` gives the columns, the parameters that it calls not linear are searched between its bounds, but for
those that are off, at a lowest value of 0, by default; `from_span` leads back to its parameters. The scale is
logarithmic for a positive parameter whose bounds are far apart; a linear one is searched as `exp` of its
share of the range: one kind of search serves both. Time, where an effect depends on it, counts from the
recording's first stamp.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, ForceColumns, Found, MotionGrid, Shape, Values
from forefeel.common.causes.friction import BAND_M_S
from forefeel.common.causes.numerics import Array, intervals_s

MOST_SHAPES = 3
# points of the first grid along each axis, by the number of axes: what a search of a second or two affords
_POINTS = {0: 1, 1: 144, 2: 16, 3: 6}
_LOOPED_POINTS = {0: 1, 1: 24, 2: 6, 3: 3}
_FAR_APART = 10.0
_FINEST = 40.0


@dataclass(frozen=True)
class GenericForce:
    """One force effect as the diagnosis uses it."""

    kind: type[ForceEffect]

    @cached_property
    def shapes(self) -> tuple[Parameter, ...]:
        """The parameters that are searched, in the order of a shape."""
        wanted = self.kind.shape_names()
        return tuple(p for p in self.kind.parameters if p.name in wanted and not p.default == p.lower == 0.0)

    def candidate(self) -> ForceColumns:
        return ForceColumns(
            signs=self._signs(), columns=self.columns, grid=self.grid, at_wall=self.kind.site == "wall",
            naming=self.named,
            sizes=tuple(p.name for p in self.kind.parameters if p.linear),
        )  # fmt: skip

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        """Its span over the motion, each stretch from rest."""
        if self.kind.site == "sensor":
            motion = replace(motion, touching=np.ones_like(motion.t))
        effect, v, m = self.effect(shape), _without_noise(motion), motion
        parts = [effect.span(m.t[p], m.x[p], v[p], m.a[p], intervals_s(m.t[p])) for p in m.pieces]
        return [np.ascontiguousarray(column) for column in np.concatenate(parts).T]

    def effect(self, shape: Shape) -> ForceEffect:
        """At that shape, linear parameters at their defaults."""
        values = {}
        for p, coordinate in zip(self.shapes, shape, strict=True):
            value = coordinate if _logarithmic(p) else p.lower + np.log(coordinate) * (p.upper - p.lower)
            values[p.name] = float(np.clip(value, p.lower, p.upper))
        return self.kind(**values)

    def grid(self, extent: Extent) -> list[Shape]:
        """Every combination of points between bounds that the recording can tell apart."""
        if not self.shapes:
            return [()]
        looped = self.kind.columns is ForceEffect.columns
        count = (_LOOPED_POINTS if looped else _POINTS)[len(self.shapes)]
        axes = [self._axis(p, extent, count) for p in self.shapes]
        return [tuple(map(float, point)) for point in product(*axes)]

    def named(self, found: Found) -> Values:
        values = self.effect(found.shape).from_span([float(c) for c in found.coefficients])
        return {name: float(value) for name, value in values.items()}

    def _axis(self, p: Parameter, extent: Extent, count: int) -> Array:
        low, high = _told_apart(p, extent)
        if _logarithmic(p):
            return np.geomspace(low, high, count)
        return np.asarray(np.exp((np.linspace(low, high, count) - p.lower) / (p.upper - p.lower)))

    def _signs(self) -> tuple[int, ...]:
        """Of the coefficients, where the bounds allow one sign only and coefficients are parameters."""
        middle = self.effect(tuple(2.0 if _logarithmic(p) else 1.5 for p in self.shapes))
        t = np.arange(3.0)
        count = int(middle.span(t, t, t, t, t).shape[1])
        if self.kind.span is not ForceEffect.span:
            return (0,) * count
        linear = [p for p in self.kind.parameters if p.linear]
        return tuple(1 if p.lower >= 0.0 else -1 if p.upper <= 0.0 else 0 for p in linear)


def _without_noise(motion: MotionGrid) -> Array:
    """The speed, where it is only noise made so small that `direction` goes evenly through it."""
    noisy = np.abs(motion.v) < motion.speed_band
    return np.where(noisy, motion.v * (BAND_M_S / max(motion.speed_band, BAND_M_S)), motion.v)


def _logarithmic(p: Parameter) -> bool:
    return p.lower > 0.0 and p.upper > _FAR_APART * p.lower


def _told_apart(p: Parameter, extent: Extent) -> tuple[float, float]:
    """Its bounds, narrowed by what the recording can tell apart in its unit."""
    e = extent
    useful: tuple[float, float] | None = {
        "m": (e.stroke_m / _FINEST, 2.0 * e.stroke_m),
        "s": (0.1 / e.cutoff_hz, e.duration_s),
        "Hz": (2.0 / e.duration_s, 0.7 * e.cutoff_hz),
        "m/s": (max(4.0 * e.speed_band, 0.01 * e.speed_m_s), 2.0 * e.speed_m_s),
    }.get(p.unit)
    if not _logarithmic(p):
        useful = (e.low_m, e.high_m) if p.unit == "m" else None
    if useful is None:
        return p.lower, p.upper
    low, high = max(p.lower, useful[0]), min(p.upper, useful[1])
    return (low, high) if low < high else (p.lower, p.upper)
