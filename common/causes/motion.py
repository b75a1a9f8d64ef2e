"""The motion that the equations of causes are written for, and the memories that they have.

A `MotionSample` is one step of plant or predictor, with floats. A `Motion` is a whole recording, with arrays
of shape (n,); a diagnosis has a `MotionGrid`, which knows where it is noisy or coarse. All have the same
members, so that one equation serves all three. At a sample a `Memory` takes a step; over a recording it runs
through each piece from rest, and neither sees nor changes what it remembers of the steps.
"""

import math
import operator
from collections import deque
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np

from forefeel.common.causes.numerics import Array, intervals_s, loop, share_above, sign_means

BAND_M_S = 1e-5
"""m/s, half the width of the linear band of a direction: a wider one makes slow friction viscous, a narrower
one lets it chatter where a servo comes to rest."""

Columns: TypeAlias = Mapping[str, float]
"""Values of what was measured beside, by its name."""
NO_COLUMNS: Columns = {}

Kinematics: TypeAlias = Any
"""A `MotionSample` or a `Motion`: no static type says that floats and arrays have one arithmetic."""
Value: TypeAlias = Any
"""A float at a `MotionSample`, an array or a float over a `Motion`."""


class MotionSample:
    """Stamp in s, motion in m, m/s, m/s^2 at the end of a step of dt in s.

    `force`: N at the gripper's jaws after the last step, positive where it resists insertion; kept for
    effects that are `by_force`.
    """

    __slots__ = ("a", "dt", "force", "further", "t", "v", "x")
    further: Columns
    rate: float
    exp = math.exp
    expm1 = math.expm1
    sin = math.sin
    cos = math.cos
    tanh = math.tanh
    rint = round
    through = operator.call
    """Output of a memory, given by its `step`, after these inputs."""
    elementwise = operator.call
    """Value of a function that is written for floats only."""

    def __init__(self, t: float, x: float, v: float, a: float, dt: float) -> None:
        self.t, self.x, self.v, self.a, self.dt = t, x, v, a, dt
        self.force, self.further = 0.0, NO_COLUMNS

    @property
    def depth(self) -> float:
        """Penetration: the position where it is positive."""
        return self.x if self.x > 0.0 else 0.0

    def direction(self) -> float:
        """sign(v), linear within the band, the usual regularisation of Coulomb's law (Armstrong-Helouvry,
        Dupont and Canudas de Wit, Automatica 30(7), 1994).
        """
        v = self.v
        return 1.0 if v >= BAND_M_S else -1.0 if v <= -BAND_M_S else v / BAND_M_S

    def along(self, x: float, v: float, a: float) -> "MotionSample":
        """Sets another motion, in place, and returns itself."""
        self.x, self.v, self.a = x, v, a
        return self

    def sign(self, u: float) -> float:
        """1 or -1, by the sign bit where u is 0."""
        return math.copysign(1.0, u)

    def above(self, u: float) -> float:
        """1 where u is positive, else 0."""
        return 1.0 if u > 0.0 else 0.0

    def positive(self, u: float) -> float:
        """max(u, 0)."""
        return u if u > 0.0 else 0.0

    def negative(self, u: float) -> float:
        """min(u, 0)."""
        return u if u < 0.0 else 0.0

    def clip(self, u: float, low: float, high: float) -> float:
        return min(max(u, low), high)


MotionSample.rate = MotionSample.v  # type: ignore[misc]  # of the step: the way gone over dt


@dataclass(frozen=True, eq=False)
class Motion:
    """A recorded motion, arrays of shape (n,); its members are those of `MotionSample`.

    `dt`: the interval before each stamp, 0 before the first, where every effect is at rest. `pieces`:
    stretches, in each of which memories begin anew. `further`: what was measured beside, by its name.
    `force`: N that were measured, if any.
    """

    t: Array
    x: Array
    v: Array
    a: Array
    dt: Array
    pieces: tuple[slice, ...] = (slice(None),)
    further: Mapping[str, Array] = field(default_factory=dict)
    force: Value = field(default=0.0, kw_only=True)

    exp = staticmethod(np.exp)
    expm1 = staticmethod(np.expm1)
    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)
    tanh = staticmethod(np.tanh)
    rint = staticmethod(np.rint)
    clip = staticmethod(np.clip)

    @classmethod
    def of(cls, t: Array, x: Array, v: Array, a: Array, force: Value = 0.0) -> "Motion":
        """Motion of one piece, dt by its stamps."""
        return Motion(t, x, v, a, intervals_s(t), force=force)

    def __getitem__(self, rows: Any) -> Self:  # noqa: ANN401 - any index of an array
        """Some of its samples, as one piece."""
        of = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "pieces"}
        some = {name: values[rows] for name, values in of.items() if isinstance(values, np.ndarray)}
        beside = {name: values[rows] for name, values in self.further.items()}
        return replace(self, **some, pieces=(slice(None),), further=beside)

    @property
    def rate(self) -> Array:
        return self.v

    @cached_property
    def depth(self) -> Array:
        return np.maximum(self.x, 0.0)

    def direction(self) -> Array:
        return np.clip(self.v / BAND_M_S, -1.0, 1.0)

    def along(self, x: Array, v: Array, a: Array) -> "Motion":
        """Copy with another motion."""
        return replace(self, x=x, v=v, a=a)

    def through(self, step: Any, *inputs: Value) -> Array:  # noqa: ANN401 - a bound `Memory.step`
        """Outputs of a memory, given by its `step`, for the inputs over each piece, from rest."""
        run = step.__self__.run
        whole = [u if isinstance(u, np.ndarray) else np.full(self.x.shape, u) for u in inputs]
        return np.concatenate([run(*(u[piece] for u in whole)) for piece in self.pieces], axis=-1)

    def elementwise(self, function: Callable[..., float], *inputs: Value) -> Array:
        rows = zip(*(np.broadcast_to(values, self.x.shape).tolist() for values in inputs), strict=True)
        return np.array([function(*row) for row in rows], dtype=np.float64)

    @staticmethod
    def sign(u: Array) -> Array:
        return np.copysign(1.0, u)

    def above(self, u: Array) -> Array:
        return np.asarray(u > 0.0, dtype=np.float64)

    @staticmethod
    def positive(u: Array) -> Array:
        return np.maximum(u, 0.0)

    @staticmethod
    def negative(u: Array) -> Array:
        return np.minimum(u, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionGrid(Motion):
    """The instrument's motion on the fine grid of a diagnosis, with the measured force, which resists.

    `touching` is 1 in contact; `speed_band`: where v is noise; `decimated`: it is coarser than the samples.
    """

    touching: Array
    speed_band: float
    decimated: bool

    @cached_property
    def rate(self) -> Array:
        """Velocity by the increments of the position: a filtered one does not add up to it."""
        steps = np.concatenate([np.diff(self.x[piece], prepend=self.x[piece][:1]) for piece in self.pieces])
        return np.asarray(np.divide(steps, self.dt, out=np.zeros_like(steps), where=self.dt > 0.0))

    def direction(self) -> Array:
        """sign(v) with a band as wide as the noise; means where the grid is coarser than the samples."""
        return self._direction

    @cached_property
    def _direction(self) -> Array:
        if self.decimated:
            return sign_means(self.v, self.speed_band)
        return np.clip(self.v / self.speed_band, -1.0, 1.0)

    def above(self, u: Array) -> Array:
        """Share of each sample in which u is positive, where the grid is coarser than the samples."""
        return share_above(u, 0.0) if self.decimated else super().above(u)


class Memory:
    """State of an effect, which declares it as a class attribute; each instance has the `step` of its own.

    A subclass gives `step` for floats. `run` is the same over arrays, from rest, often as a loop in C.
    """

    start: ClassVar[Any] = 0.0
    """State at rest."""

    def __init__(self) -> None:
        self.reset()

    def step(self, *inputs: Any) -> Any:  # noqa: ANN401 - floats, as many as the memory has
        """Output after a step."""
        raise NotImplementedError

    def run(self, *inputs: Any) -> Array:  # noqa: ANN401 - arrays, as many as `step` has floats
        """Output after each step from rest, shape (n,) or (outputs, n)."""
        fresh = copy(self)
        fresh.reset()
        rows = zip(*(values.tolist() for values in inputs), strict=True)
        return np.array([fresh.step(*row) for row in rows], dtype=np.float64).T

    def reset(self) -> None:
        self.value = self.start


class PrandtlElement(Memory):
    """`s <- clip(s + u, -1, 1)`: a spring in series with dry friction (Prandtl, ZAMM 8(2), 1928)."""

    def step(self, u: float) -> Value:
        s = self.value + u
        self.value = s = -1.0 if s < -1.0 else 1.0 if s > 1.0 else s
        return s

    @staticmethod
    def run(u: Array) -> Array:
        return loop("prandtl_element", u)


class Increment(Memory):
    """`u - u_before`, 0 at the first."""

    start = None

    def step(self, u: float) -> Value:
        before, self.value = self.value, u
        return 0.0 if before is None else u - before

    @staticmethod
    def run(u: Array) -> Array:
        return np.diff(u, prepend=u[:1])


class Most(Memory):
    """`y <- max(y, u)`: as far as something was pushed, at least 0."""

    def step(self, u: float) -> Value:
        self.value = max(self.value, u)
        return self.value

    @staticmethod
    def run(u: Array) -> Array:
        return np.maximum.accumulate(np.maximum(u, 0.0))


class Relay(Memory):
    """1 from u > high on until u < low, 0 at first (Krasnosel'skii and Pokrovskii, see `Gap`); in the step in
    which it switches the share of that behind the limit, u straight in between.
    """

    start = (0.0, 0.0)

    def step(self, u: float, high: float, low: float) -> Value:
        on, before = self.value
        now = 1.0 if u > high else 0.0 if u < low else on
        self.value = now, u
        limit = high if now else low
        return now if now == on or u == before else on + (now - on) * min((u - limit) / (u - before), 1.0)

    @staticmethod
    def run(u: Array, high: Array, low: Array) -> Array:
        last = np.maximum.accumulate(np.where((u > high) | (u < low), np.arange(len(u)), -1))
        now = np.where(last >= 0, u > high, False)[np.maximum(last, 0)].astype(np.float64)
        on, way = np.append(0.0, now[:-1]), np.diff(u, prepend=0.0)
        behind = np.divide(u - np.where(now > 0.0, high, low), way, out=np.ones_like(u), where=way != 0.0)
        return np.asarray(on + (now - on) * np.minimum(behind, 1.0))


class Bristle(Memory):
    """`du = (1 - u sgn(d)) d`, exact for any d, with decay = exp(-|d|): saturates at +-1 (Dahl, 1968)."""

    def step(self, d: float, decay: float) -> Value:
        if d > 0.0:
            self.value = 1.0 - (1.0 - self.value) * decay
        elif d < 0.0:
            self.value = (1.0 + self.value) * decay - 1.0
        return self.value

    @staticmethod
    def run(d: Array, decay: Array) -> Array:
        return loop("bristle", d, decay)


class Lag(Memory):
    """`tau y' = u - y`, exact for u constant over dt, with decay = exp(-dt / tau)."""

    def step(self, u: float, decay: float) -> Value:
        before = u if self.value is None else self.value
        self.value = y = u + (before - u) * decay
        return y

    @staticmethod
    def run(u: Array, decay: Array) -> Array:
        return loop("lag", u, decay, 0.0)


class SettledLag(Lag):
    """`Lag` that is settled at its first input."""

    start = None

    @staticmethod
    def run(u: Array, decay: Array) -> Array:
        return loop("lag", u, decay, float(u[0])) if len(u) else u


class Delay(Memory):
    """`y(t) = u(t - delay_s)`, straight between the steps; before its first input that one is taken."""

    def reset(self) -> None:
        self.value: deque[tuple[float, float]] = deque()

    def step(self, u: float, t: float, delay_s: float) -> Value:
        """Takes u at t; returns u of `delay_s` before, straight between the steps."""
        past, then = self.value, t - delay_s
        past.append((t, u))
        while len(past) > 1 and past[1][0] <= then:
            past.popleft()
        start, before = past[0]
        if then <= start or len(past) == 1:
            return before
        end, after = past[1]
        return before + (after - before) * (then - start) / (end - start)

    @staticmethod
    def run(u: Array, t: Array, delay_s: Array) -> Array:
        return np.interp(t - delay_s, t, u) if len(t) else u


class Gap(Memory):
    """Play operator `y <- min(max(y, x - half), x + half)`; outputs y, and 1 where it is carried, else 0.

    Within the gap, in whose middle it begins, y goes by `decay` a step towards `rest`; with a `rest` of NaN
    it stays. Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989.
    """

    start = None

    def step(self, x: float, half: float, rest: float, decay: float) -> tuple[float, float]:
        """Advances y by a step; returns y, and 1 where x carries it at a distance of `half`, else 0. In
        between y goes by the factor `decay` towards `rest`, or stays if `rest` is NaN.
        """
        stays, low, high = math.isnan(rest), x - half, x + half
        if self.value is None:
            self.value = x if stays else min(max(rest, low), high)
        free = self.value if stays else rest + (self.value - rest) * decay
        self.value = y = low if free < low else high if free > high else free
        return y, 1.0 if y != free else 0.0

    @staticmethod
    def run(x: Array, half: Array, rest: Array, decay: Array) -> Array:
        return loop("gap", x, half, rest, decay, outputs=2)


class Oscillator(Memory):
    """(z, z') of `z'' + 2 d w z' + w^2 z = a`, exact for an acceleration constant over dt.

    ec, es: exp(-d w dt) times cos and sin / w_d of w_d dt. decay: d w. square: w^2.
    """

    start = (0.0, 0.0)

    def step(self, a: float, ec: float, es: float, decay: float, square: float) -> Value:
        (z, w), rest = self.value, a / square
        y = z - rest
        self.value = rest + (ec + decay * es) * y + es * w, (ec - decay * es) * w - square * es * y
        return self.value

    @staticmethod
    def run(a: Array, ec: Array, es: Array, decay: Array, square: Array) -> Array:
        return loop("oscillator", a, ec, es, decay, square, outputs=2)
