"""What an effect is: one physical cause, written once, used by the plant, the predictor and the diagnosis.

Five kinds. A `ForceEffect` adds a force that is linear in some of its parameters:
`f = sum_i theta_i phi_i(motion, state)`. A `MotionEffect` stands between stage and instrument and changes the
motion; a `FactorEffect` stands between tip and stage and changes the force. A `ContactEffect` decides whether
the wall is touched. A `SensorEffect` stands between force and reading.
All are pure: time is an argument, the only state are their memories, `reset` forgets it.

Each is one equation: a method of the motion, which is a `MotionSample` for the plant and the predictor and a
`Motion` of a whole recording for the fit of the predictor and for the diagnosis, see `motion`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from forefeel.common.causes.motion import Kinematics, Memory, Motion, Value
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
    explains: float = 0.3
    """Standard deviation of a linear term before anything is known, over the spread of the force.

    A spring may explain all of it, and a bias has nothing to do with it. Others less: of the first stroke a
    breath or a mass explain as much, and then foretell the second one wrongly. Least of all d^2 and d^3,
    which grow 8 times as a stroke goes twice as far: with 0.3, a run with a loaded cause had 2 times the
    error of the one before.
    """

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

    The state is in class attributes that are a `Memory`; each effect has the `step` of its own instead.

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
    picture: ClassVar[str] = "time"
    """The variable in which it shows, a key of `forefeel.results.pictures`."""
    kin: ClassVar[str] = ""
    """Name of the thing on a bench that several causes describe: a model holds one of them, and none is the
    rival of another.
    """
    rubs: ClassVar[bool] = False
    """Dry friction in any of its descriptions, which are no rivals of each other."""
    bends: ClassVar[bool] = False
    """Turns and scales a force by its frequency."""
    needs_spring: ClassVar[bool] = False
    """Beside no spring it is a damper that comes late, as dry friction is where the motion turns."""
    told_by: ClassVar[Sequence[str]] = ()
    """Motions that tell it from what is alike, keys of `forefeel.diagnosis.identifiability`."""
    of_its_run: ClassVar[bool] = False
    """Says nothing of another run."""
    sized_anew: ClassVar[bool] = False
    """May be there in another run, in another size."""
    clocked: ClassVar[bool] = False
    """Has an instant or a phase by the clock of its run."""
    occasional: ClassVar[bool] = False
    """Takes part in the predictor's contact only where it explains enough."""
    instead_of: ClassVar[str] = ""
    """The parameter of `mass_damper_spring` that it says all of."""
    candidates: ClassVar[Sequence["Candidate"]] = ()
    """How a diagnosis fits it; a force effect without any is fitted by its `span`, see `generic`."""
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

    def reset(self) -> None:
        """Forgets the state, as after a new contact."""
        for name in self._memories:
            getattr(self, name).__self__.reset()

    @property
    def remembers(self) -> bool:
        """True where what it gives depends on more than the motion at this instant."""
        return bool(self._memories)


class ForceEffect(Effect):
    """A force that adds to the others; positive resists insertion."""

    site: ClassVar[Site]

    @abstractmethod
    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """phi_i, one per linear parameter, in the same order; the motion is that at the end of the step."""

    def columns(self, motion: Motion) -> Array:
        """phi_i of a whole recording, from rest, shape (n, linear parameters)."""
        names = self.linear_names
        rows = np.empty((len(names), len(motion.t)))
        for i, phi in zip(range(len(names)), self.regressors(motion), strict=True):
            rows[i] = phi
        return rows.T

    def span(self, motion: Motion) -> Array:
        """Columns whose combinations are all that the effect can be at its `shape_names`, shape (n, m).

        By default `columns`. An effect overrides it where nonlinear parameters become linear in other
        coordinates, as amplitude and phase do in sine and cosine; `from_span` leads back.
        """
        return self.columns(motion)

    def from_span(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Every parameter by name, from the coefficients of `span`; not checked against the bounds."""
        return {**self.values, **dict(zip(self.linear_names, map(float, coefficients), strict=True))}

    @classmethod
    def shape_names(cls) -> tuple[str, ...]:
        """The parameters that `span` depends on: what is left to search after a linear fit."""
        return tuple(p.name for p in cls.parameters if not p.linear)

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
    def moved(self, m: Kinematics) -> Kinematics:
        """The instrument's motion, of the kind that m is: `m.along` other positions."""


class FactorEffect(Effect):
    """Something along the instrument that lets more or less of the tip's force through, by the motion."""

    @abstractmethod
    def factor(self, m: Kinematics, force_n: Value) -> Value:
        """Factor of the forces of shaft and wall; force_n: their sum at the tip."""


class ContactEffect(Effect):
    """Decides whether the wall is touched at all."""

    @abstractmethod
    def contact(self, m: Kinematics) -> tuple[Value, Value]:
        """(depth beyond the contact position in m, 1 in contact and 0 without) of the instrument's motion."""


class SensorEffect(Effect):
    """Something between the force and its reading."""

    linear: ClassVar[bool] = False
    """Whether the reading of a sum is the sum of the readings, so that it may be taken of each regressor."""

    @abstractmethod
    def reading(self, m: Kinematics, force_n: Value) -> Value:
        """The reading in N of a force at m.t, m.dt after the last."""
