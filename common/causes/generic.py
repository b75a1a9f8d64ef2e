"""Form of a force effect that declares none, such as one of another distribution.

Its `span` gives the columns, and `from_span` the parameters. The parameters in `shape_names` are searched
between their bounds, except those that are off by default: default and lower bound are 0. The scale is
logarithmic for a positive parameter whose bounds are far apart; others are searched as `exp` of their share
of the range, so that one kind of search serves both. Time counts from the recording's first stamp.
"""

from dataclasses import replace
from functools import partial
from itertools import product
from typing import Self

import numpy as np

from forefeel.common.causes.base import Effect, ForceEffect, Parameter
from forefeel.common.causes.candidate import Extent, Fitted, Form, Shape, Values
from forefeel.common.causes.motion import Motion, MotionGrid
from forefeel.common.causes.numerics import Array

MOST_SHAPES = 3
# points of the first grid along each axis, by the number of axes: a search of a second or two
_POINTS = {0: 1, 1: 144, 2: 16, 3: 6}
_FAR_APART = 10.0
_FINEST = 40.0


class GenericForce(Form):
    """Columns of a span, over shapes between the bounds of the parameters."""

    def of(self, kind: type[Effect]) -> Self:
        """Returns a copy for the effect `kind`: grid by its searched parameters, sizes by its linear ones.
        Signs follow from the bounds, or are free if `kind` overrides `span`.
        """
        form = super().of(kind)
        sizes, grid = tuple(p.name for p in kind.parameters if p.linear), partial(_grid, form.searched)
        if form.kind.span is ForceEffect.span:
            return replace(form, sizes=sizes, grid=grid)
        middle = form.effect(tuple(2.0 if _logarithmic(p) else 1.5 for p in form.searched))
        count = middle.span(Motion.of(*np.ones((4, 3)))).shape[1]
        return replace(form, sizes=sizes, grid=grid, signs=(0,) * count)

    @property
    def searched(self) -> tuple[Parameter, ...]:
        """Parameters that are searched, in the order of a shape."""
        wanted = self.kind.shape_names()
        return tuple(p for p in self.kind.parameters if p.name in wanted and not p.default == p.lower == 0.0)

    def values_at(self, shape: Shape) -> Values:
        values = {}
        for p, coordinate in zip(self.searched, shape, strict=True):
            value = coordinate if _logarithmic(p) else p.lower + np.log(coordinate) * (p.upper - p.lower)
            values[p.name] = float(value)
        return values

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        return list(self.effect(shape).span(motion).T)

    def named(self, fitted: Fitted) -> Values:
        values = self.effect(fitted.shape).from_span([float(c) for c in fitted.coefficients])
        return {name: float(value) for name, value in values.items()}


def _grid(searched: tuple[Parameter, ...], extent: Extent) -> list[Shape]:
    """Every combination of points on the axes of the parameters; an axis spans `_useful_bounds`."""
    axes = [_axis(p, extent, _POINTS[len(searched)]) for p in searched]
    return [tuple(map(float, point)) for point in product(*axes)]


def _axis(p: Parameter, extent: Extent, count: int) -> Array:
    low, high = _useful_bounds(p, extent)
    if _logarithmic(p):
        return np.geomspace(low, high, count)
    return np.asarray(np.exp((np.linspace(low, high, count) - p.lower) / (p.upper - p.lower)))


def _logarithmic(p: Parameter) -> bool:
    return p.lower > 0.0 and p.upper > _FAR_APART * p.lower


def _useful_bounds(p: Parameter, extent: Extent) -> tuple[float, float]:
    """Returns the bounds of a parameter, narrowed to the values that a recording of that extent resolves. A
    unit of m, s, Hz or m/s narrows them, by the recording's stroke, length, cutoff or speed. On a linear
    scale only m does, to the range of positions. If nothing would be left, they are not narrowed.
    """
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
