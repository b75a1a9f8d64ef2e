"""Forms in which a diagnosis fits a cause: columns of a regression at given shape parameters.

A shape parameter is one that the force is not linear in (a width, a time constant, a frequency). It is
searched between bounds that the recording itself sets: nothing shorter than its bandwidth or longer than
itself. A cause may have several forms, `name:form`, of which a model holds one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.base import ContactEffect, Effect, Site
from forefeel.common.causes.motion import Motion, MotionGrid
from forefeel.common.causes.numerics import Array

Spectrum = NDArray[np.complex128]
Shape = tuple[float, ...]
Model = Mapping[str, Shape]
"""Names of causes and their shape parameters; mass, damping and stiffness always take part."""
Values = dict[str, float]
Entry = dict[str, Any]
"""An effect of a model.yaml."""


@dataclass(frozen=True, slots=True)
class ColumnExtent:
    """Name, unit and range of a column that was recorded beside."""

    name: str
    unit: str
    extent: float


@dataclass(frozen=True, slots=True)
class Extent:
    """Bandwidth, length and ranges of a recording, from which the bounds of the shape parameters follow."""

    cutoff_hz: float
    duration_s: float
    stroke_m: float
    speed_m_s: float
    low_m: float
    high_m: float
    speed_band: float
    low_n: float
    high_n: float
    further: tuple[ColumnExtent, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that were recorded beside."""
        return tuple(column.name for column in self.further)

    @property
    def range_m(self) -> float:
        """From the lowest to the highest position."""
        return self.high_m - self.low_m

    @property
    def reach_m(self) -> float:
        """The farthest from zero."""
        return max(abs(self.low_m), abs(self.high_m))


@dataclass(frozen=True, slots=True)
class Fitted:
    """Coefficients and shape of one cause in a fit, positive force resisting.

    `base`: mass, damping and stiffness of the same fit; `start_s`: stamp from which its times count;
    `column`: the other column that it follows, if it follows one.
    """

    coefficients: Array
    shape: Shape
    base: Array
    start_s: float
    column: str = ""


Grid = Callable[[Extent], list[Shape]]
Naming = Callable[[Fitted], Values]
Make = Callable[[Fitted], list[Entry]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One form of a cause, as it is fitted and named. Subclasses define its part in the regression.

    Attributes:
        form: "" or the name that distinguishes it from other forms of the same cause.
        kind: the class of the effect; by default that of the cause, see `of`.
        values: parameters of the effect by its shape, where `shapes` are not these.
        coefficients, shapes: the parameters that its coefficients and its shape are, in their order.
        naming, making: override `named` and `entries`.
        signs: of its coefficients when positive force resists, +1, or 0 for either.
        grid, logarithmic: shapes that are tried first, none where the force is linear in the cause, and
            whether they are searched on a logarithmic scale.
        least_score, least_ratio: by how much the penalised -2 log likelihood must fall for it, and by which
            factor the residual's rms must grow without it.
        price: what it must fall beside that, for each row: a form with more freedom than its numbers say.
        sizes: parameters that are zero without the cause: it is not named while the intervals of all of them
            contain zero; by default `coefficients`.
        picture: overrides that of its effect.
        costly: has many shapes, and is tried only where more than noise is left.
        at_start: those of its coefficients, by index, that are a state at the recording's start.
        plainer: the form of the same cause with fewer numbers, which stands in where this one is doubted.
    """

    form: str = ""
    kind: type[Any] = Effect
    values: Callable[[Shape], Values] | None = None
    coefficients: tuple[str, ...] = ()
    shapes: tuple[str, ...] = ()
    naming: Naming | None = None
    making: Make | None = None
    signs: tuple[int, ...] = ()
    grid: Grid = lambda _: [()]
    logarithmic: bool = True
    least_score: float = 12.0
    least_ratio: float = 1.1
    price: float = 0.0
    sizes: tuple[str, ...] | None = None
    picture: str = ""
    costly: bool = False
    at_start: tuple[int, ...] = ()
    plainer: str | None = None

    def of(self, kind: type[Effect]) -> Self:
        """Copy for that cause: `kind` is set unless the form names another effect."""
        effect_kind = self.kind if hasattr(self.kind, "name") else kind
        return replace(self, kind=effect_kind, picture=self.picture or kind.picture)

    def effect(self, shape: Shape) -> Any:  # noqa: ANN401 - of `kind`
        """The effect at that shape, clipped to its bounds; other parameters have their defaults."""
        return self.kind(**within(self.kind, self.values_at(shape)))

    def values_at(self, shape: Shape) -> Values:
        return self.values(shape) if self.values else dict(zip(self.shapes, shape, strict=True))

    def named(self, fitted: Fitted) -> Values:
        """Parameters by name from a fit, as reported: by `naming`, else as `coefficients` and `shapes`."""
        if self.naming is not None:
            return self.naming(fitted)
        linear = dict(zip(self.coefficients, fitted.coefficients, strict=False))
        return {**linear, **dict(zip(self.shapes, fitted.shape, strict=True))}

    @property
    def needed(self) -> tuple[str, ...]:
        """`sizes`, by default `coefficients`."""
        return self.coefficients if self.sizes is None else self.sizes

    def entries(self, fitted: Fitted) -> list[Entry]:
        """Entries of a model.yaml from a fit."""
        return [entry(self.kind, self.named(fitted))] if self.making is None else self.making(fitted)


@dataclass(frozen=True, kw_only=True, eq=False)
class Form(Candidate):
    """Regressors of a force effect at a shape, by default with one coefficient per linear parameter.

    Attributes:
        site: where it acts in this form, if not at its own site.
        mix: row i is what coefficient i adds to the linear parameters, where these are not the coefficients.
        beside: computes further columns, of no parameter, from (motion, shape, regressors).
        happens: True if what the cause is named after happens along a motion at a shape, or it is not fitted.
        elements: number of effects in parallel, each with an equal part of the shape.
    """

    site: Site | None = None
    mix: tuple[tuple[float, ...], ...] = ()
    beside: Callable[[MotionGrid, Shape, Array], list[Array]] | None = None
    happens: Callable[[MotionGrid, Shape], bool] = lambda motion, shape: True
    elements: int = 1

    def of(self, kind: type[Effect]) -> Self:
        """Copy for that cause; signs and coefficients, if not given, follow from its linear parameters."""
        form = super().of(kind)
        linear = [p for p in form.kind.parameters if p.linear]
        signs = tuple(1 if p.lower >= 0.0 else -1 if p.upper <= 0.0 else 0 for p in linear)
        names = () if form.mix or form.naming else tuple(p.name for p in linear)
        return replace(form, signs=form.signs or signs, coefficients=form.coefficients or names)

    @property
    def at_wall(self) -> bool:
        """True if it acts in contact only."""
        return (self.site or self.kind.site) == "wall"

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        """Returns the cause's columns in a regression, (n,) each; `shape`: its searched parameters.

        The `elements` get equal parts of the shape. Each has the columns of its coefficients (its regressors,
        or their mixture by `mix`), then those of `beside`.
        """
        columns: list[Array] = []
        for part in map(tuple, np.reshape(shape, (self.elements, -1)).tolist()):
            phi = self.effect(part).columns(motion).T
            columns += list(np.array(self.mix) @ phi if self.mix else phi)
            columns += self.beside(motion, part, phi) if self.beside else []
        return columns

    def named(self, fitted: Fitted) -> Values:
        """Parameters by name from a fit; without `coefficients`, what results from `mix`, and the shape's."""
        if self.naming is not None or self.coefficients:
            return super().named(fitted)
        theta = np.array(self.mix).T @ fitted.coefficients[: len(self.mix)]
        linear = [p.name for p in self.kind.parameters if p.linear]
        return {**dict(zip(linear, map(float, theta), strict=True)), **self.values_at(fitted.shape)}


class PositionWave(Form):
    """Waves over the position, whose period in m is searched in the residual of the other causes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadingColumns(Candidate):
    """Columns of the time in s since the recording's start, by default the span of the effect.

    `over_time`: computes other ones from (t, shape).
    """

    over_time: Callable[[Array, Shape], Array] | None = None

    def columns(self, t: Array, shape: Shape) -> Array:
        """Shape (n, coefficients)."""
        if self.over_time is not None:
            return self.over_time(t, shape)
        return np.asarray(self.effect(shape).span(Motion(t, t, t, t, t)))


class Periodic(ReadingColumns):
    """Lines of a spectrum, which are searched in the residual of the other causes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mode(Candidate):
    """Spectra of forces, by `spectra` from (rad/s, spectrum of the acceleration, shape)."""

    spectra: Callable[[Array, Spectrum, Shape], list[Spectrum]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Changing(Candidate):
    """A cause that changes the columns of all others, and has its own column if it has a coefficient.

    `mass_site`: where the mass is, by the motion that it makes: the stage's, before all that changes motion
    or force (sensor), the instrument's with or without contact (shaft), or in contact only (wall). `drags`:
    the damper is along the shaft, with or without contact.
    """

    mass_site: Site = "wall"
    drags: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment(Changing):
    """Multiplies the spectra of all forces by `factor` of (rad/s, shape)."""

    factor: Callable[[Array, Shape], Spectrum]


@dataclass(frozen=True, kw_only=True, eq=False)
class Transmission(Changing):
    """Changes the motion for all forces. Its own column is the acceleration of a second mass behind it."""

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        return [motion.a]

    def moved(self, motion: MotionGrid, shape: Shape) -> MotionGrid:
        """Returns the motion behind the cause at a shape; the given motion stays as it is.

        Behind a motion effect, such as play, it is the instrument's; a contact effect changes `x` to the
        depth beyond the contact, at least 0, and `touching`, 1 in contact.
        """
        effect = self.effect(shape)
        if isinstance(effect, ContactEffect):
            depth, touching = effect.contact(motion)
            return replace(motion, x=motion.positive(depth), touching=touching)
        moved: MotionGrid = effect.moved(motion)
        return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class Modulation(Changing):
    """Multiplies all forces by a factor at each instant. Its own column is a constant force at the tip.

    `by_tip`: it depends on the sign of the tip's force, zero at the reading shape[-1]; else the tip pushes.
    """

    by_tip: bool = False

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        return [np.ones_like(motion.x)]

    def factor(self, motion: MotionGrid, shape: Shape) -> Array:
        force_n = motion.force - shape[-1] if self.by_tip else 1.0
        return np.asarray(self.effect(shape).factor(motion, force_n))


def within(kind: type[Effect], values: Values) -> Values:
    """Clips the values to the bounds of the effect's parameters; leaves out those that are no parameters."""
    bounds = {p.name: (p.lower, p.upper) for p in kind.parameters if p.name in values}
    return {name: float(min(max(values[name], low), high)) for name, (low, high) in bounds.items()}


def entry(kind: type[Effect], values: Values) -> Entry:
    """Entry of a model.yaml, values clipped to bounds; a shorthand sets what is not named itself."""
    spelled = {t: v for name, v in values.items() for t in kind.shorthands.get(name, ())}
    return {"effect": kind.name, "parameters": within(kind, {**spelled, **values})}


def form_name(cause: str, form: str) -> str:
    """Name `cause:form` of a form, or the cause's of its plain one."""
    return f"{cause}:{form}" if form else cause


def base_name(name: str) -> str:
    """Name of the cause of a form `name:form`."""
    return name.partition(":")[0]


def log_grid(low: float, high: float, count: int) -> list[Shape]:
    """`count` values from low to high, evenly in the logarithm."""
    return [(float(value),) for value in np.geomspace(low, max(high, low * 1.01), count)]


def two(grid: list[Shape]) -> list[Shape]:
    """Every pair of different values of a grid of one parameter, the earlier one first."""
    single = [point[0] for point in grid]
    return [(short, long) for i, short in enumerate(single) for long in single[i + 1 :]]
