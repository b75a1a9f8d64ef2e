"""What an effect is: one physical cause, written once, used by the plant, the predictor and the diagnosis.

Five kinds. A `ForceEffect` adds a force that is linear in some of its parameters:
`f = sum_i theta_i phi_i(motion, state)`. A `MotionEffect` stands between stage and instrument and changes the
motion; a `FactorEffect` stands between tip and stage and changes the force. A `ContactEffect` decides whether
the wall is touched. A `SensorEffect` stands between force and reading.
All are pure: time is an argument, the only state is their own, `reset` forgets it.

Each has two forms of the same physics. One steps through time with Python floats, for the plant and the
predictor. The other takes a whole recording as arrays, for the diagnosis: it begins at rest at the first
stamp, steps over the intervals between the stamps, and neither sees nor changes the state of the first. By
default it is the first in a loop.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from forefeel.common.causes.numerics import Array

if TYPE_CHECKING:
    from forefeel.common.causes.candidate import Candidate

Site = Literal["wall", "shaft", "sensor"]
"""Where a force arises: at the wall (in contact), along the shaft (when gripped), in the sensor (always)."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter: its name ends in its unit; `linear` when the force is proportional to it."""

    name: str
    unit: str
    default: float
    lower: float
    upper: float
    linear: bool = True

    def checked(self, value: object, place: str) -> float:
        """`value` as a float.

        Raises:
            ValueError: not a number, not finite or out of bounds; one line that starts with `place`.
        """
        if (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and self.lower <= value <= self.upper
        ):
            return float(value)
        bounds = f"[{self.lower:g}, {self.upper:g}] {self.unit}".rstrip()
        raise ValueError(f"{place} = {value!r}: expected a number in {bounds}")


class Effect(ABC):
    """Common part of all effects: a name, bounded parameters by name, a state that can be forgotten.

    Raises:
        ValueError: unknown parameter, or a value that is not finite or out of its bounds; one line.
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    reference: ClassVar[str]
    fingerprint: ClassVar[str] = ""
    """One sentence: what it looks like in the residual of a model that lacks it."""
    words: ClassVar[str] = ""
    """What it is, in everyday words."""
    remedy: ClassVar[str] = ""
    """What a bench can do against it."""
    equation: ClassVar[tuple[str, ...]] = ()
    """Its term of `f = m x'' + b x' + k x + ...`, with its parameters in braces, in SI units; another one for
    other parameters. Behind a semicolon: the equation of a state that the term has. Of an effect that adds no
    force: what it does to x or f.
    """
    candidates: ClassVar[Sequence["Candidate"]] = ()
    """How a diagnosis fits it; a force effect without any is fitted by its `span`, see `generic`."""
    shorthands: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """A name that sets several parameters at once, such as `force_n` of a symmetric friction."""

    def __init__(self, **values: float) -> None:
        self.values: Mapping[str, float] = self.complete(values)
        self._configure()
        self.reset()

    @classmethod
    def complete(cls, values: Mapping[str, object], place: str = "") -> dict[str, float]:
        """Every parameter by name: `values` checked and their shorthands spelled out, defaults for the rest.

        Raises:
            ValueError: as the class; the line starts with `place`, or with the effect's name.
        """
        known = {parameter.name: parameter for parameter in cls.parameters}
        given: dict[str, float] = {}
        for name, value in values.items():
            where = f"{place or cls.name}.{name}"
            for target in cls.shorthands.get(name, (name,)):
                if target not in known:
                    expected = ", ".join([*known, *cls.shorthands])
                    raise ValueError(f"{where}: unknown parameter, expected one of {expected}")
                if target in given:
                    raise ValueError(f"{where}: sets {target} a second time")
                given[target] = known[target].checked(value, where)
        return {p.name: given.get(p.name, p.default) for p in cls.parameters}

    def revalue(self, **values: float) -> None:
        """Takes other values and keeps the state, as when a model is corrected while it runs."""
        self.values = self.complete(values)
        self._configure()

    def _configure(self) -> None:  # noqa: B027 - a hook, empty by default
        """Derives from `values` what the step needs; called once for each set of them."""

    def reset(self) -> None:  # noqa: B027 - an effect without memory has nothing to forget
        """Forgets the state, as after a new contact."""

    @property
    def remembers(self) -> bool:
        """Whether what it gives depends on more than the motion at this instant."""
        return type(self).reset is not Effect.reset


class ForceEffect(Effect):
    """A force that adds to the others; positive resists insertion."""

    site: ClassVar[Site]

    @abstractmethod
    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """phi_i after advancing the state by dt to time t: one per linear parameter, in the same order.

        Units: t, dt s; x m; v m/s; a m/s^2. `x, v, a` are the motion at the end of the step.
        """

    def columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        """phi_i of a whole recording, shape (n, linear parameters).

        t, x, v, a: stamps in s and the motion at them, shape (n,). dt: the interval before each stamp, see
        `numerics.intervals_s`.
        """
        fresh = type(self)(**self.values)
        rows = [fresh.regressors(*at) for at in zip(*(c.tolist() for c in (t, x, v, a, dt)), strict=True)]
        return np.array(rows, dtype=np.float64).reshape(len(t), len(self.linear_names))

    def span(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        """Columns whose combinations are all that the effect can be at its `shape_names`, shape (n, m).

        By default `columns`. An effect overrides it where nonlinear parameters become linear in other
        coordinates, as amplitude and phase do in sine and cosine; `from_span` leads back.
        """
        return self.columns(t, x, v, a, dt)

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Every parameter by name, from the coefficients of `span`; not checked against the bounds."""
        return {**self.values, **dict(zip(self.linear_names, map(float, coefficients), strict=True))}

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        """The parameters that `span` depends on: what is left to search after a linear fit."""
        return tuple(p.name for p in cls.parameters if not p.linear)

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """The force in N after advancing the state by dt. Call this or `regressors`, once per step."""
        phi = self.regressors(t, x, v, a, dt)
        return sum(theta * p for theta, p in zip(self.linear_values, phi, strict=True))

    @property
    def linear_names(self) -> tuple[str, ...]:
        """The linear parameters, in the order of `regressors`."""
        return tuple(p.name for p in self.parameters if p.linear)

    @property
    def linear_values(self) -> tuple[float, ...]:
        """theta_i, in the order of `regressors`."""
        return tuple(self.values[name] for name in self.linear_names)


class MotionEffect(Effect):
    """Something between stage and instrument: the instrument's motion from the stage's."""

    @abstractmethod
    def transform(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, float, float]:
        """(x, v, a) of the instrument after advancing the state by dt to time t."""

    def path(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> tuple[Array, Array, Array]:
        """(x, v, a) of the instrument over a whole recording, each shape (n,); see `columns`."""
        fresh = type(self)(**self.values)
        rows = [fresh.transform(*at) for at in zip(*(c.tolist() for c in (t, x, v, a, dt)), strict=True)]
        moved = np.array(rows, dtype=np.float64).reshape(len(t), 3)
        return moved[:, 0], moved[:, 1], moved[:, 2]


class FactorEffect(Effect):
    """Something along the instrument that lets more or less of the tip's force through, by the motion."""

    @abstractmethod
    def factor(self, x: float, v: float, force_n: float) -> float:
        """By which the forces of shaft and wall are multiplied.

        x in m and v in m/s are the instrument's, force_n the sum of these forces at the tip.
        """

    def factors(self, x: Array, v: Array, force_n: Array) -> Array:
        """`factor` over a whole recording, shape (n,)."""
        at = zip(x.tolist(), v.tolist(), force_n.tolist(), strict=True)
        return np.array([self.factor(*each) for each in at], dtype=np.float64)


class ContactEffect(Effect):
    """Decides whether the wall is touched at all."""

    @abstractmethod
    def penetration_m(self, x: float, v: float) -> float | None:
        """Depth beyond the contact position in m, or None without contact; x, v are the instrument's."""

    def penetrations_m(self, x: Array, v: Array) -> Array:
        """Depth over a whole recording, shape (n,); nan without contact."""
        depths = map(self.penetration_m, x.tolist(), v.tolist())
        return np.array([np.nan if depth is None else depth for depth in depths])


class SensorEffect(Effect):
    """Something between the force and its reading."""

    linear: ClassVar[bool] = False
    """Whether the reading of a sum is the sum of the readings, so that it may be taken of each regressor."""

    @abstractmethod
    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The reading in N after advancing the state by dt to time t."""

    def readings(self, t: Array, force_n: Array, dt: Array) -> Array:
        """The readings of a whole recording, shape (n,); see `ForceEffect.columns`."""
        fresh = type(self)(**self.values)
        steps = zip(*(c.tolist() for c in (t, force_n, dt)), strict=True)
        return np.array([fresh.sense(*at) for at in steps], dtype=np.float64)
