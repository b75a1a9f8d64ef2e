"""Base classes of effects: one physical cause each, used by the plant, the predictor and the diagnosis.

Five kinds. A `ForceEffect` adds a force that is linear in some of its parameters:
`f = sum_i theta_i phi_i(motion, state)`. A `MotionEffect` stands between stage and instrument and changes the
motion; a `FactorEffect` stands between tip and stage and changes the force. A `ContactEffect` decides whether
the wall is touched. A `SensorEffect` stands between force and reading.
All are pure: time is an argument, the only state are their memories, `reset` forgets it.

Each is one equation: a method of the motion, which is a `MotionSample` for the plant and the predictor and a
`Motion` of a whole recording for the fit of the predictor and for the diagnosis, see `motion`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from forefeel.common.causes.motion import Kinematics, Memory, Motion, Value
from forefeel.common.causes.numerics import Array

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
    explains: float = 0.3
    """Standard deviation of a linear term before anything is known, over the spread of the force.

    A spring may explain all of it, and a bias has nothing to do with it. Others less: of the first stroke a
    breath or a mass explain as much, and then foretell the second one wrongly. Least of all d^2 and d^3,
    which grow 8 times as a stroke goes twice as far: with 0.3, a run with a loaded cause had 2 times the
    error of the one before.
    """

    def checked(self, value: object, place: str) -> float:
        """Returns `value` as a float.

        Raises:
            ValueError: a bool or no number, not finite, or out of bounds; one line that starts with `place`.
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
    """Common part of all effects: a name, bounded parameters by name, a state that `reset` clears.

    The state is in the class attributes that are a `Memory`; each instance has the `step` of its own instead.

    Raises:
        ValueError: unknown parameter, or a value that is not finite or out of its bounds; one line.
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    reference: ClassVar[str]
    fingerprint: ClassVar[str] = ""
    """One sentence: its shape in the residual of a model that lacks it."""
    words: ClassVar[str] = ""
    """Its name in everyday words."""
    remedy: ClassVar[str] = ""
    """Advice to whoever runs the bench."""
    equation: ClassVar[tuple[str, ...]] = ()
    """Its term of `f = m x'' + b x' + k x + ...`, parameters in braces, in SI units; the first entry counts
    whose parameters are all given. The equation of a state follows a semicolon. An effect that adds no force
    has a phrase on x or f instead.
    """
    picture: ClassVar[str] = "time"
    """The variable over which it shows, a key of `forefeel.results.pictures`."""
    kin: ClassVar[str] = ""
    """Name of the part of a bench that several causes describe: a model holds only one of them, and a
    diagnosis does not report them as rivals.
    """
    rubs: ClassVar[bool] = False
    """Describes dry friction; a diagnosis does not report two such causes as rivals."""
    bends: ClassVar[bool] = False
    """Turns and scales a force by its frequency."""
    rotary: ClassVar[bool] = False
    """Is a function of an angle; a diagnosis searches it only where the position is one."""
    needs_spring: ClassVar[bool] = False
    """A diagnosis rejects it without a stiffness: it then is a late damper, like friction at a reversal."""
    of_its_run: ClassVar[bool] = False
    """Holds for its own run only."""
    sized_anew: ClassVar[bool] = False
    """Acts in another run, too, but with another size."""
    clocked: ClassVar[bool] = False
    """Has an instant or a phase on the clock of its run."""
    occasional: ClassVar[bool] = False
    """The predictor's contact model contains it only if it explains enough."""
    instead_of: ClassVar[str] = ""
    """Parameter of `mass_damper_spring` whose whole value it takes over."""
    candidates: ClassVar[Sequence[Any]] = ()
    """Forms of `candidate` in which a diagnosis fits it. A force effect without any is fitted by its `span`,
    see `generic`.
    """
    shorthands: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """A name that sets several parameters at once, such as `force_n` of a symmetric friction."""

    _memories: ClassVar[Mapping[str, Memory]] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        added = {name: value for name, value in vars(cls).items() if isinstance(value, Memory)}
        cls._memories = {**cls._memories, **added}
        for name in added:
            delattr(cls, name)  # Python reads an attribute of the instance faster where its class has none

    def __init__(self, **values: float) -> None:
        for name, memory in self._memories.items():
            setattr(self, name, type(memory)().step)
        self.values: Mapping[str, float] = self.complete(values)
        self._configure()
        self.reset()

    @classmethod
    def complete(cls, values: Mapping[str, object], place: str = "") -> dict[str, float]:
        """Returns every parameter by name: `values` checked, shorthands spelled out, defaults for the rest.

        Raises:
            ValueError: unknown, set twice, no number or out of bounds; one line that starts with `place`, by
                default the effect's name.
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

    @classmethod
    def described(cls, values: Mapping[str, float], text: Callable[[str, float], str]) -> str:
        """Text on what its parameters amount to, which follows `words`; "" where they say it themselves.

        `text`: of a quantity, by a name that ends in its unit, and its value.
        """
        return ""

    def revalue(self, **values: float) -> None:
        """Replaces all values, by defaults where not given, and keeps the state: for a model that runs."""
        self.values = self.complete(values)
        self._configure()

    def _configure(self) -> None:  # noqa: B027 - a hook, empty by default
        """Derives from `values` what the step needs; called once for each set of them."""

    def reset(self) -> None:
        """Clears the state, as after a new contact."""
        for name in self._memories:
            getattr(self, name).__self__.reset()

    @property
    def remembers(self) -> bool:
        """True if the output depends on earlier samples, too."""
        return bool(self._memories)


class ForceEffect(Effect):
    """A force that adds to the others; positive resists insertion."""

    site: ClassVar[Site]

    @abstractmethod
    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """phi_i, one per linear parameter, in their order; advances the memories if m is a `MotionSample`."""

    def columns(self, motion: Motion) -> Array:
        """phi_i of a whole recording, from rest, shape (n, linear parameters)."""
        names = self.linear_names
        rows = np.empty((len(names), len(motion.t)))
        for i, phi in zip(range(len(names)), self.regressors(motion), strict=True):
            rows[i] = phi
        return rows.T

    def span(self, motion: Motion) -> Array:
        """Columns whose linear combinations are all forces of the effect at its `shape_names`, shape (n, m).

        By default `columns`. An effect overrides it where nonlinear parameters become linear in other
        coordinates, as amplitude and phase do in sine and cosine; `from_span` is the inverse.
        """
        return self.columns(motion)

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Every parameter by name, from the coefficients of `span`; not checked against the bounds."""
        return {**self.values, **dict(zip(self.linear_names, map(float, coefficients), strict=True))}

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        """The parameters that `span` depends on; a fit has to search these."""
        return tuple(p.name for p in cls.parameters if not p.linear)

    @property
    def linear_names(self) -> tuple[str, ...]:
        """Linear parameters, in the order of `regressors`."""
        return tuple(p.name for p in self.parameters if p.linear)

    @property
    def linear_values(self) -> tuple[float, ...]:
        """theta_i, in the order of `regressors`."""
        return tuple(self.values[name] for name in self.linear_names)


class MotionEffect(Effect):
    """A cause between stage and instrument, which changes the motion."""

    by_force: ClassVar[bool] = False
    """Depends on `force` of the motion."""

    @abstractmethod
    def moved(self, m: Kinematics) -> Kinematics:
        """The instrument's motion for the stage's motion m, of the type of m, see `along`."""


class FactorEffect(Effect):
    """A cause along the instrument, which multiplies the tip's force by a factor of the motion."""

    @abstractmethod
    def factor(self, m: Kinematics, force_n: Value) -> Value:
        """Factor by which the forces of shaft and wall are multiplied; force_n: their sum at the tip."""


class ContactEffect(Effect):
    """A cause that decides if the wall is touched."""

    @abstractmethod
    def contact(self, m: Kinematics) -> tuple[Value, Value]:
        """(depth beyond the contact position in m, 1 in contact and 0 without) of the instrument's motion."""


class SensorEffect(Effect):
    """A cause between the force and its reading."""

    linear: ClassVar[bool] = False
    """True if the reading of a sum is the sum of the readings, so that it applies to each regressor."""

    @abstractmethod
    def reading(self, m: Kinematics, force_n: Value) -> Value:
        """The reading in N of a force at m.t, m.dt after the last one."""
