"""What an effect is to the generator: where it acts, how it is drawn, what it does, how it is scaled."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from tests.hidden_effects.generator.motion import Motion
from tests.hidden_effects.generator.scan import Array

Values = Mapping[str, float]
Draw = Callable[[np.random.Generator, "Scene"], dict[str, float]]
Scale = Callable[[Values, float], dict[str, float]]


class Place(IntEnum):
    """Where on the way from stage to reading an effect acts; smaller acts first."""

    STAGE = 0
    WALL = 1
    FORCE = 2
    CHAIN = 3
    READING = 4


@dataclass(frozen=True)
class Base:
    """Mass, damper, spring in contact: `m a + b v + k x`."""

    mass_kg: float
    damping_n_s_m: float
    stiffness_n_m: float

    def force(self, x: Array, v: Array, a: Array) -> Array:
        """In N."""
        return self.mass_kg * a + self.damping_n_s_m * v + self.stiffness_n_m * x


@dataclass(frozen=True)
class Scene:
    """What an effect's parameters are drawn for."""

    motion: Motion
    base: Base
    force: Array
    duration_s: float
    rate_hz: float


@dataclass
class Signal:
    """What passes through the effects: the instrument's motion and the force, on one grid."""

    base: Base
    t: Array
    x: Array
    v: Array
    a: Array
    force: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def step_s(self) -> float:
        return float(self.t[1] - self.t[0])


Act = Callable[[Signal, Values], None]


@dataclass(frozen=True)
class Form:
    """One mathematical form of an effect.

    `judged` are the parameters with the vocabulary's names and meaning; `linear` says that the added force is
    proportional to the scale; `own_size` forms are drawn at their size, not scaled to a share. `kinked`
    forces need wider steps in a numerical Jacobian. A `light` form needs a small mass: a play of a few
    micrometres that lets go of a large one takes all of the inertia away.
    """

    name: str
    label: str
    place: Place
    draw: Draw
    act: Act
    scaled: Scale
    judged: tuple[str, ...] = ()
    linear: bool = True
    own_size: bool = False
    kinked: bool = False
    light: bool = False
    shares: tuple[float, float] = (0.15, 0.5)
    inserted: bool | None = None
    lowest_rate_hz: float = 50.0


@dataclass(frozen=True)
class Part:
    form: Form
    values: Values

    def scaled(self, factor: float) -> "Part":
        return Part(self.form, self.form.scaled(self.values, factor))

    def with_value(self, name: str, value: float) -> "Part":
        return Part(self.form, {**self.values, name: value})

    @property
    def parameters(self) -> dict[str, float]:
        return {name: self.values[name] for name in self.form.judged if self.values[name] != 0.0}


def proportional(*names: str) -> Scale:

    def scale(values: Values, factor: float) -> dict[str, float]:
        return {name: value * factor if name in names else value for name, value in values.items()}

    return scale


def inverse(*names: str) -> Scale:

    def scale(values: Values, factor: float) -> dict[str, float]:
        return {name: value / factor if name in names else value for name, value in values.items()}

    return scale


def added(force: Callable[[Signal, Values], Array]) -> Act:

    def act(signal: Signal, values: Values) -> None:
        signal.force = signal.force + force(signal, values)

    return act


def transmit(motion: Motion, base: Base, parts: tuple[Part, ...]) -> Array:
    """The force on the motion's grid before it is read, without noise.

    The wall's force is computed between the stage's parts and the others.
    """
    signal = Signal(base, motion.t, motion.x, motion.v, motion.a)
    ordered = sorted(parts, key=lambda part: part.form.place)
    for part in ordered:
        if part.form.place is Place.STAGE:
            part.form.act(signal, part.values)
    signal.force = base.force(signal.x, signal.v, signal.a)
    for part in ordered:
        if Place.STAGE < part.form.place <= Place.CHAIN:
            part.form.act(signal, part.values)
    return signal.force
