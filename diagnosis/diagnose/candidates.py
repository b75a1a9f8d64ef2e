"""The causes that can be named, each as columns of a regression at given shape parameters.

A shape parameter is one that the force is not linear in (a width, a time constant, a frequency). It is
searched between bounds that the recording itself sets: nothing shorter than its bandwidth or longer than
itself.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from forefeel.common.effects.backlash import Backlash
from forefeel.common.effects.presliding_hysteresis import PreslidingHysteresis
from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose import kinks
from forefeel.diagnosis.diagnose.signals import Signals

Kind = Literal["force", "sensor", "motion", "contact", "alignment", "mode"]
"""force: columns of the motion; sensor: columns of time; mode: of the spectrum; the others change all
columns."""

Shape = tuple[float, ...]

Model = Mapping[str, Shape]
"""Names of causes and their shape parameters; mass, damping and stiffness always take part."""


@dataclass(frozen=True, eq=False)
class MotionGrid:
    """The instrument's motion on the fine grid; `touching` is 1 in contact; `speed_band` where v is noise."""

    t: Floats
    x: Floats
    v: Floats
    a: Floats
    touching: Floats
    pieces: tuple[slice, ...]
    speed_band: float
    decimated: bool

    @cached_property
    def direction(self) -> Floats:
        """sign(v), linear where the speed is within its noise; means where samples are coarser than raw."""
        if self.decimated:
            return kinks.direction(self.v, self.speed_band)
        return np.clip(self.v / self.speed_band, -1.0, 1.0)


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

    @property
    def reach_m(self) -> float:
        """The farthest from zero."""
        return max(abs(self.low_m), abs(self.high_m))

    @classmethod
    def of(cls, signals: Signals, speed_band: float) -> "Extent":
        """From the motion as recorded, robust against its extremes."""
        recorded = signals.recorded
        low, q1, q2, high = np.quantile(signals.fine_x[recorded], (0.005, 0.05, 0.95, 0.995))
        return cls(
            signals.cutoff_hz,
            float(signals.t[-1] - signals.t[0]),
            float(q2 - q1),
            float(np.quantile(np.abs(signals.fine_v[recorded]), 0.95)),
            float(low),
            float(high),
            speed_band,
        )


Columns = Callable[[MotionGrid, Shape], list[Floats]]
Grid = Callable[[Extent], list[Shape]]


@dataclass(frozen=True, slots=True)
class Candidate:
    """One name of the vocabulary, or `name:form` where it has several forms.

    `signs`: of its coefficients when positive force resists, +1, or 0 for either. `columns`: at a shape.
    `grid`: shapes that are tried first; `logarithmic`: whether they are searched on a logarithmic scale.
    `at_wall`: whether it acts in contact only.
    """

    name: str
    kind: Kind
    signs: tuple[int, ...] = ()
    columns: Columns | None = None
    grid: Grid = lambda extent: [()]
    logarithmic: bool = True
    at_wall: bool = False


def log_grid(low: float, high: float, count: int) -> list[Shape]:
    """`count` values from low to high, evenly in the logarithm."""
    return [(float(value),) for value in np.geomspace(low, max(high, low * 1.01), count)]


def _stribeck(motion: MotionGrid, shape: Shape) -> list[Floats]:
    s = motion.direction
    return [s, s * np.exp(-((motion.v / shape[0]) ** 2))]


def _stribeck_exponential(motion: MotionGrid, shape: Shape) -> list[Floats]:
    s = motion.direction
    return [s, s * np.exp(-np.abs(motion.v) / shape[0])]


def _exponential(motion: MotionGrid, shape: Shape) -> list[Floats]:
    """Fung's wall without its linear part."""
    depth = np.clip(motion.x / shape[0], -_STEEPEST, _STEEPEST)
    return [np.expm1(depth) - depth]


def _both_directions(motion: MotionGrid, shape: Shape) -> list[Floats]:
    s = motion.direction
    return [np.maximum(s, 0.0), np.minimum(s, 0.0)]


def _presliding(motion: MotionGrid, shape: Shape) -> list[Floats]:
    effect = PreslidingHysteresis(force_n=1.0, stiffness_n_m=1.0 / shape[0])
    u = np.empty_like(motion.x)
    for piece in motion.pieces:
        x = motion.x[piece]
        step = np.diff(x, prepend=x[:1])
        u[piece] = effect.columns(motion.t[piece], x, step, step, np.ones_like(x))[:, 0]
    return [u]


def _bristles(motion: MotionGrid, shape: Shape) -> list[Floats]:
    """LuGre: the bristles' deflection and its rate."""
    (u,) = _presliding(motion, shape)
    rate = np.concatenate([np.gradient(u[p], motion.t[p]) for p in motion.pieces])
    return [u, rate]


def _two_lengths(motion: MotionGrid, shape: Shape) -> list[Floats]:
    """Two elements of a generalised Maxwell slip (Al-Bender, Lampaert, Swevers, IEEE T-AC 50(11), 2005)."""
    return _presliding(motion, shape[:1]) + _presliding(motion, shape[1:])


def _two(grid: list[Shape]) -> list[Shape]:
    single = [point[0] for point in grid]
    return [(short, long) for i, short in enumerate(single) for long in single[i + 1 :]]


def _relaxation(motion: MotionGrid, shape: Shape) -> list[Floats]:
    """`q' = v - q / tau` from rest, by the increments of the position; and what an earlier stroke left,
    exp(-t/tau).
    """
    from scipy.signal import lfilter  # noqa: PLC0415

    q = np.empty_like(motion.x)
    for piece in motion.pieces:
        x = motion.x[piece]
        dt = float(motion.t[piece][1] - motion.t[piece][0])
        decay = np.exp(-dt / shape[0])
        gain = shape[0] / dt * (1.0 - decay)
        q[piece] = lfilter([gain], [1.0, -decay], np.diff(x, prepend=x[:1]))
    first = np.zeros_like(q)
    first[motion.pieces[0]] = np.exp(-motion.t[motion.pieces[0]] / shape[0])
    return [q, first]


def _two_branches(motion: MotionGrid, shape: Shape) -> list[Floats]:
    return _relaxation(motion, shape[:1]) + _relaxation(motion, shape[1:])


def _creep(motion: MotionGrid, shape: Shape) -> list[Floats]:
    return [1.0 - np.exp(-motion.t / shape[0])]


def _depth(motion: MotionGrid) -> Floats:
    """Penetration: the position where it is positive; all of it where the recording has no such origin."""
    return np.maximum(motion.x, 0.0)


def play(motion: MotionGrid, width_m: float) -> MotionGrid:
    """The instrument's motion behind a play of that width."""
    effect = Backlash(width_m=width_m)
    parts = [effect.path(motion.t[p], motion.x[p], motion.v[p], motion.a[p]) for p in motion.pieces]
    x, v, a = (np.concatenate(column) for column in zip(*parts, strict=True))
    return MotionGrid(motion.t, x, v, a, motion.touching, motion.pieces, motion.speed_band, motion.decimated)


def touch(motion: MotionGrid, contact_m: float) -> MotionGrid:
    """The motion as depth beyond the contact position; nothing before it."""
    instants = np.asarray(motion.x > contact_m, dtype=np.float64)
    touching = kinks.beyond(motion.x, contact_m) if motion.decimated else instants
    depth = np.maximum(motion.x - contact_m, 0.0)
    return MotionGrid(
        motion.t, depth, motion.v, motion.a, touching, motion.pieces, motion.speed_band, motion.decimated
    )


def _places(extent: Extent) -> list[Shape]:
    """Finer where the stroke ends: a contact that is lost there is lost for a moment only."""
    shares = (0.015, 0.035, *np.linspace(0.06, 0.85, 15))
    return [(extent.low_m + float(share) * (extent.high_m - extent.low_m),) for share in shares]


def _modes(extent: Extent) -> list[Shape]:
    low, high = max(0.7, 4.0 / extent.duration_s), HIGHEST_MODE * extent.cutoff_hz
    return [(f, z) for (f,) in log_grid(low, high, 16) for z in (0.04, 0.15)]


def base_name(name: str) -> str:
    """The name in the vocabulary of one of its forms."""
    return name.partition(":")[0]


_STEEPEST = 50.0

DRY = frozenset({"coulomb_friction", "stribeck_friction", "presliding_hysteresis"})
"""Descriptions of one and the same contact: a model holds at most one of them."""

HIGHEST_MODE = 0.85
"""Of the cutoff: a mode above shows no side of its peak that falls."""

MOST_DAMPED = 0.3
"""A mode with more damping has no peak to know it by."""


CANDIDATES: dict[str, Candidate] = {
    candidate.name: candidate
    for candidate in (
        Candidate("bias", "sensor", (0,), lambda m, s: [np.ones_like(m.t)]),
        Candidate("coulomb_friction", "force", (1,), lambda m, s: [m.direction]),
        Candidate(
            "stribeck_friction", "force", (1, 1), _stribeck,
            lambda e: log_grid(max(0.02 * e.speed_m_s, 4.0 * e.speed_band), 0.4 * e.speed_m_s, 6),
        ),
        Candidate("coulomb_friction:asymmetric", "force", (1, 1), _both_directions),
        Candidate(
            "stribeck_friction:exponential", "force", (1, 1), _stribeck_exponential,
            lambda e: log_grid(max(0.02 * e.speed_m_s, 4.0 * e.speed_band), 0.4 * e.speed_m_s, 6),
        ),
        Candidate(
            "presliding_hysteresis:bristles", "force", (1, 1), _bristles,
            lambda e: log_grid(0.003 * e.stroke_m, 0.7 * e.stroke_m, 10),
        ),
        Candidate(
            "presliding_hysteresis:two", "force", (1, 1), _two_lengths,
            lambda e: _two(log_grid(0.003 * e.stroke_m, 0.7 * e.stroke_m, 5)),
        ),
        Candidate(
            "stress_relaxation:two", "force", (1, 0, 1, 0), _two_branches,
            lambda e: _two(log_grid(2.0 / e.cutoff_hz, 0.25 * e.duration_s, 6)), at_wall=True,
        ),
        Candidate(
            "contact_loss:carried", "contact", logarithmic=False,
            grid=_places,
        ),
        Candidate(
            "sensor_drift:creep", "sensor", (0,), _creep,
            lambda e: log_grid(0.1 * e.duration_s, 0.7 * e.duration_s, 5),
        ),
        Candidate("unmodelled_resonance:fixture", "alignment", grid=_modes),
        Candidate(
            "presliding_hysteresis", "force", (1,), _presliding,
            lambda e: log_grid(0.003 * e.stroke_m, 0.7 * e.stroke_m, 10),
        ),
        Candidate("backlash", "motion", grid=lambda e: log_grid(0.005 * e.stroke_m, 0.6 * e.stroke_m, 9)),
        Candidate("stiffening", "force", (0, 0), lambda m, s: [m.x**2, m.x**3], at_wall=True),
        Candidate(
            "stiffening:exponential", "force", (1,), _exponential,
            lambda e: log_grid(0.12 * e.reach_m, 1.5 * e.reach_m, 6), at_wall=True,
        ),
        Candidate("hunt_crossley_damping", "force", (1,), lambda m, s: [_depth(m) * m.v], at_wall=True),
        Candidate("quadratic_drag", "force", (1,), lambda m, s: [m.v * np.abs(m.v)]),
        Candidate("asymmetric_damping", "force", (0,), lambda m, s: [np.abs(m.v)], at_wall=True),
        Candidate(
            "stress_relaxation", "force", (1, 0), _relaxation,
            lambda e: log_grid(2.0 / e.cutoff_hz, 0.25 * e.duration_s, 10), at_wall=True,
        ),
        Candidate(
            "contact_loss", "contact", logarithmic=False,
            grid=_places,
        ),
        Candidate(
            "position_dependent_friction", "force", (1,), lambda m, s: [_depth(m) * m.direction],
            at_wall=True
        ),
        Candidate(
            "stiffness_change", "force", (0,), lambda m, s: [m.x * (m.t > s[0])], logarithmic=False,
            grid=lambda e: [(float(t),) for t in np.linspace(0.0, e.duration_s, 32)[2:-2]], at_wall=True,
        ),
        Candidate("time_delay", "alignment", grid=lambda e: log_grid(0.1 / e.cutoff_hz, 0.3, 12)),
        Candidate("sensor_lag", "alignment", grid=lambda e: log_grid(0.1 / e.cutoff_hz, 0.5, 10)),
        Candidate("sensor_drift", "sensor", (0,), lambda m, s: [m.t]),
        Candidate("pulsation", "sensor", (0,) * 6, None),
        Candidate("unmodelled_resonance", "mode", (1,), None, _modes),
        Candidate("unmodelled_resonance:free", "mode", (0, 0), None, _modes),
    )
}  # fmt: skip
