"""Effects of other distributions (entry points of the group `forefeel.effects`) as causes that can be named.

A force effect is tried like ours: its `span` gives the columns, the parameters that it calls not linear are
searched between its bounds, `from_span` leads back to its parameters. The scale is logarithmic for a positive
parameter whose bounds are far apart; a linear one is searched as `exp` of its share of the range, so that one
kind of search serves both. Time, where an effect depends on it, counts from the recording's first stamp.
Effects on motion, contact or reading are not searched: they would change the columns of all others.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from forefeel.common.effects.base import Effect, ForceEffect, Parameter
from forefeel.common.effects.registry import OWN, effect_class, effect_names
from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose.candidates import CANDIDATES, Candidate, Extent, MotionGrid, Shape
from forefeel.diagnosis.diagnose.extended import MAKERS, Entry
from forefeel.diagnosis.diagnose.parameters import NAMINGS

MOST_SHAPES = 3
_POINTS = {0: 1, 1: 144, 2: 16, 3: 6}
_LOOPED_POINTS = {0: 1, 1: 24, 2: 6, 3: 3}
_FAR_APART = 10.0
_FINEST = 40.0


@dataclass(frozen=True)
class ThirdParty:
    """One force effect as the diagnosis uses it."""

    kind: type[ForceEffect]

    @cached_property
    def shapes(self) -> tuple[Parameter, ...]:
        """The parameters that are searched, in the order of a shape."""
        wanted = self.kind.shape_names()
        return tuple(p for p in self.kind.parameters if p.name in wanted)

    def candidate(self) -> Candidate:
        """Named as the effect."""
        at_wall = self.kind.site == "wall"
        return Candidate(
            self.kind.name, "force", self._signs(), self.columns, self.grid, logarithmic=True, at_wall=at_wall
        )

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Floats]:
        """Its span over the motion, each stretch from rest."""
        if self.kind.site == "sensor":
            motion = replace(motion, touching=np.ones_like(motion.t))
        effect = self.effect(shape)
        parts = [effect.span(motion.t[p], motion.x[p], motion.v[p], motion.a[p]) for p in motion.pieces]
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
        looped = self.kind._columns is ForceEffect._columns
        count = (_LOOPED_POINTS if looped else _POINTS)[len(self.shapes)]
        axes = [self._axis(p, extent, count) for p in self.shapes]
        return [tuple(map(float, point)) for point in product(*axes)]

    def named(self, coefficients: Floats, shape: Shape, base: Floats, start_s: float) -> dict[str, float]:
        """Every parameter by name, linear ones from the coefficients; see `parameters.Naming`."""
        found = self.effect(shape).from_span(coefficients.tolist())
        return {name: float(value) for name, value in found.items()}

    def made(self, coefficients: Floats, shape: Shape, base: Floats, start_s: float) -> list[Entry]:
        """For a model.yaml, within the effect's bounds; see `extended.Make`."""
        bounds = {p.name: (p.lower, p.upper) for p in self.kind.parameters}
        values = self.named(coefficients, shape, base, start_s)
        inside = {name: float(np.clip(value, *bounds[name])) for name, value in values.items()}
        return [{"effect": self.kind.name, "parameters": inside}]

    def _axis(self, p: Parameter, extent: Extent, count: int) -> Floats:
        low, high = _told_apart(p, extent)
        if _logarithmic(p):
            return np.geomspace(low, high, count)
        return np.exp((np.linspace(low, high, count) - p.lower) / (p.upper - p.lower))

    def _signs(self) -> tuple[int, ...]:
        """Of the coefficients, where the bounds allow one sign only and coefficients are parameters."""
        middle = self.effect(tuple(2.0 if _logarithmic(p) else 1.5 for p in self.shapes))
        t = np.arange(3.0)
        count = int(middle.span(t, t, t, t).shape[1])
        if self.kind.span is not ForceEffect.span:
            return (0,) * count
        linear = [p for p in self.kind.parameters if p.linear]
        return tuple(1 if p.lower >= 0.0 else -1 if p.upper <= 0.0 else 0 for p in linear)


def third_party_candidates(said: Callable[[str], None] = lambda line: None) -> Mapping[str, Candidate]:
    """What is installed and can be searched, by name; `said` hears in one line why another can not."""
    return {name: effect.candidate() for name, effect in _searchable(said).items()}


def register_plugins(said: Callable[[str], None] = lambda line: None) -> None:
    """Lets CANDIDATES, NAMINGS and MAKERS know what is installed now, and nothing that no longer is."""
    found = _searchable(said)
    for known in (CANDIDATES, NAMINGS, MAKERS):
        for name in [name for name in known if name.partition(":")[0] not in OWN and name not in found]:
            del known[name]
    for name, effect in found.items():
        CANDIDATES[name], NAMINGS[name], MAKERS[name] = effect.candidate(), effect.named, effect.made


def fingerprint(name: str) -> str:
    """What a cause looks like in the residual; empty where its effect does not say."""
    kind: type[Effect] | None = OWN.get(name)
    if kind is None and name in CANDIDATES:
        kind = effect_class(name)
    return kind.fingerprint if kind is not None else ""


def _searchable(said: Callable[[str], None]) -> dict[str, ThirdParty]:
    found: dict[str, ThirdParty] = {}
    for name in effect_names():
        if name in OWN:
            continue
        try:
            kind = effect_class(name)
        except ValueError as error:
            said(f"not searched: {error}")
            continue
        if not issubclass(kind, ForceEffect):
            said(f"not searched: {name} adds no force")
        elif len(kind.shape_names()) > MOST_SHAPES:
            said(f"not searched: {name} has {len(kind.shape_names())} parameters that are not linear")
        else:
            found[name] = ThirdParty(kind)
    return found


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
