"""What an effect is: one physical cause, written once, used by the plant, the predictor and the diagnosis.

Four kinds. A `ForceEffect` adds a force that is linear in some of its parameters:
`f = sum_i theta_i phi_i(motion, state)`. A `MotionEffect` stands between stage and instrument and changes the
motion. A `ContactEffect` decides whether the wall is touched. A `SensorEffect` stands between force and
reading.
All are pure: time is an argument, the only state is their own, `reset` forgets it.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

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

    def _configure(self) -> None:  # noqa: B027 - a hook, empty by default
        """Derives from `values` what the step needs; called once."""

    def reset(self) -> None:  # noqa: B027 - an effect without memory has nothing to forget
        """Forgets the state, as after a new contact."""


class ForceEffect(Effect):
    """A force that adds to the others; positive resists insertion."""

    site: ClassVar[Site]

    @abstractmethod
    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """phi_i after advancing the state by dt to time t: one per linear parameter, in the same order.

        Units: t, dt s; x m; v m/s; a m/s^2. `x, v, a` are the motion at the end of the step.
        """

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


class ContactEffect(Effect):
    """Decides whether the wall is touched at all."""

    @abstractmethod
    def penetration_m(self, x: float) -> float | None:
        """Depth beyond the contact position in m, or None without contact."""


class SensorEffect(Effect):
    """Something between the force and its reading."""

    @abstractmethod
    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The reading in N after advancing the state by dt to time t."""
