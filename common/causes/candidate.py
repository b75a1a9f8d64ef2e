"""How a diagnosis fits a cause: as columns of a regression, at given shape parameters.

A shape parameter is one that the force is not linear in (a width, a time constant, a frequency). It is
searched between bounds that the recording itself sets: nothing shorter than its bandwidth or longer than
itself. A cause may have several forms, `name:form`, of which a model holds one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.base import Effect, Site
from forefeel.common.causes.numerics import Array, sign_means

Spectrum = NDArray[np.complex128]
Shape = tuple[float, ...]
Model = Mapping[str, Shape]
"""Names of causes and their shape parameters; mass, damping and stiffness always take part."""
Values = dict[str, float]
Entry = dict[str, Any]
"""An effect of a model.yaml."""


@dataclass(frozen=True, eq=False)
class MotionGrid:
    """The instrument's motion on the fine grid and the measured force in N; `touching` is 1 in contact;
    `speed_band` where v is noise.
    """

    t: Array
    x: Array
    v: Array
    a: Array
    touching: Array
    pieces: tuple[slice, ...]
    speed_band: float
    decimated: bool
    force: Array

    @cached_property
    def direction(self) -> Array:
        """sign(v), linear where the speed is within its noise; means where samples are coarser than raw."""
        if self.decimated:
            return sign_means(self.v, self.speed_band)
        return np.clip(self.v / self.speed_band, -1.0, 1.0)

    @property
    def depth(self) -> Array:
        """Penetration: the position where it is positive."""
        return np.maximum(self.x, 0.0)


@dataclass(frozen=True, slots=True)
class Extent:
    """What a recording can tell apart: bounds of the shape parameters."""

    cutoff_hz: float
    duration_s: float
    stroke_m: float
    speed_m_s: float
    low_m: float
    high_m: float
    speed_band: float
    low_n: float
    high_n: float

    @property
    def range_m(self) -> float:
        """From the lowest to the highest position."""
        return self.high_m - self.low_m

    @property
    def reach_m(self) -> float:
        """The farthest from zero."""
        return max(abs(self.low_m), abs(self.high_m))


@dataclass(frozen=True, slots=True)
class Found:
    """What a fit found of one cause, positive force resisting.

    `base`: mass, damping and stiffness of the same fit; `start_s`: stamp from which its times count.
    """

    coefficients: Array
    shape: Shape
    base: Array
    start_s: float


Grid = Callable[[Extent], list[Shape]]
Naming = Callable[[Found], Values]
Make = Callable[[Found], list[Entry]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One form of a cause as it is fitted and told. Its subclasses say what it does to the regression.

    Attributes:
        form: "" or what tells it from other forms of the same cause.
        coefficients, shapes: the parameters that its coefficients and its shape are, in their order.
        naming, making: its parameters, its entries of a model.yaml, where these are others.
        signs: of its coefficients when positive force resists, +1, or 0 for either.
        grid, logarithmic: shapes that are tried first, none where the force is linear in the cause, and
            whether they are searched on a logarithmic scale.
        least_score, least_ratio: by how much the penalised -2 log likelihood must fall for it, and by which
            factor the residual's rms must grow without it.
        sizes: parameters at whose zero there is no such cause: it is not named while the intervals of all of
            them hold zero; by default the linear ones.
        picture: the variable in which it shows.
        costly: it has many shapes, and is tried only where more than noise is left.
    """

    form: str = ""
    coefficients: tuple[str, ...] = ()
    shapes: tuple[str, ...] = ()
    naming: Naming | None = None
    making: Make | None = None
    signs: tuple[int, ...] = ()
    grid: Grid = lambda _: [()]
    logarithmic: bool = True
    least_score: float = 12.0
    least_ratio: float = 1.1
    sizes: tuple[str, ...] | None = None
    picture: str = "time"
    costly: bool = False

    def named(self, found: Found) -> Values:
        if self.naming is not None:
            return self.naming(found)
        linear = dict(zip(self.coefficients, found.coefficients, strict=False))
        return {**linear, **dict(zip(self.shapes, found.shape, strict=True))}

    @property
    def needed(self) -> tuple[str, ...]:
        """`sizes`, or their default."""
        return self.coefficients if self.sizes is None else self.sizes

    def entries(self, found: Found, kind: type[Effect]) -> list[Entry]:
        """What a model.yaml says of it; `kind`: the cause's class."""
        return [entry(kind, self.named(found))] if self.making is None else self.making(found)


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceColumns(Candidate):
    """Columns of the motion; `at_wall`: of the motion in contact only."""

    columns: Callable[[MotionGrid, Shape], list[Array]]
    at_wall: bool = False


class PositionWave(ForceColumns):
    """Waves over the position, whose period in m is searched in what the rest leaves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadingColumns(Candidate):
    """Columns of the time in s since the recording's start, shape (n, coefficients)."""

    columns: Callable[[Array, Shape], Array]


class Periodic(ReadingColumns):
    """Lines of a spectrum, which are searched in what the rest leaves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mode(Candidate):
    """Spectra that follow the acceleration's: of (rad/s, spectrum of the acceleration, shape)."""

    spectra: Callable[[Array, Spectrum, Shape], list[Spectrum]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Changing(Candidate):
    """It changes the columns of all others, and has one of its own where it has a coefficient.

    `mass_site`: where the mass is, by the motion that it makes: the stage's, before all that changes motion
    or force (sensor), the instrument's with or without contact (shaft), or in contact only (wall).
    """

    mass_site: Site = "wall"


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment(Changing):
    """A factor of the spectra of all forces: of (rad/s, shape)."""

    factor: Callable[[Array, Shape], Spectrum]


@dataclass(frozen=True, kw_only=True, eq=False)
class Transmission(Changing):
    """Another motion for all forces. Its own column is the instrument's acceleration, of a second mass."""

    moved: Callable[[MotionGrid, Shape], MotionGrid]


@dataclass(frozen=True, kw_only=True, eq=False)
class Modulation(Changing):
    """A factor of all forces at each instant: of (motion, shape). Its own column is a constant of the tip's.

    `zero_n`: of a factor that asks for the sign of the tip's force, the reading at which it takes that force
    to be zero, by its shape.
    """

    factor: Callable[[MotionGrid, Shape], Array]
    zero_n: Callable[[Shape], float] | None = None


def entry(kind: type[Effect], values: Values) -> Entry:
    """One effect, its parameters within the effect's bounds; a shorthand counts where no parameter is."""
    bounds = {p.name: (p.lower, p.upper) for p in kind.parameters}
    known = {name: value for name, value in values.items() if name in bounds}
    if not known:
        known = {t: value for name, value in values.items() for t in kind.shorthands.get(name, ())}
    inside = {name: float(np.clip(value, *bounds[name])) for name, value in known.items()}
    return {"effect": kind.name, "parameters": inside}


def base_name(name: str) -> str:
    """The name in the vocabulary of one of its forms."""
    return name.partition(":")[0]


def log_grid(low: float, high: float, count: int) -> list[Shape]:
    """`count` values from low to high, evenly in the logarithm."""
    return [(float(value),) for value in np.geomspace(low, max(high, low * 1.01), count)]


def two(grid: list[Shape]) -> list[Shape]:
    """Every pair of different values of a grid."""
    single = [point[0] for point in grid]
    return [(short, long) for i, short in enumerate(single) for long in single[i + 1 :]]
