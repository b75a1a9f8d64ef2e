"""How the stage moves: paths of a hand or a motion controller, on the fine grid of the simulation."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import ndtr

Array = NDArray[np.float64]
Rng = np.random.Generator

STEP_S = 1.0 / 20_000.0
"""Of the simulation. The fastest mode of a bench is the load cell's, below 1.5 kHz: 13 steps a period."""
BEFORE_S = 1.0
"""The stage moves for so long before the record starts: friction, play and relaxation have a past."""
AFTER_S = 0.01  # s, that the simulation goes on behind the record
_FASTEST_M_S = 0.15  # m/s, of a stage
_COARSE_S = 1e-3  # s; what is commanded, 25 times finer than any servo below follows


@dataclass(frozen=True)
class Stage:
    """The stage's motion from -BEFORE_S to a little after the end of the record, which starts at 0."""

    t: Array
    x: Array
    v: Array
    a: Array

    def at(self, time_s: Array) -> tuple[Array, Array, Array]:
        x, v, a = (np.interp(time_s, self.t, column) for column in (self.x, self.v, self.a))
        return x, v, a


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def smoothed(values: Array, time_constant_s: float, step_s: float = STEP_S) -> Array:
    """A first-order lag that starts settled."""
    pole = float(np.exp(-step_s / time_constant_s))
    filtered, _ = lfilter([1.0 - pole], [1.0, -pole], values, zi=[pole * values[0]])
    return np.asarray(filtered)


def _lognormal_strokes(rng: Rng, t: Array, stroke_m: float) -> Array:
    """A hand: strokes with a lognormal profile of speed (Plamondon, Biol. Cybern. 72, 1995), with holds."""
    x, at, now = np.zeros_like(t), 0.0, float(t[0])
    slow, rest_share = log_uniform(rng, 0.15, 0.5), rng.uniform(0.1, 0.6)
    while now < t[-1]:
        target, took_s = rng.uniform(0.0, stroke_m), slow * log_uniform(rng, 0.6, 4.0)
        first = int(np.searchsorted(t, now, "right"))
        x[first:] += (target - at) * ndtr(np.log((t[first:] - now) / took_s) / rng.uniform(0.2, 0.5))
        at, now = target, now + took_s * rng.uniform(1.2, 2.2)
        now += rng.uniform(0.2, 2.5) if rng.random() < rest_share else 0.0
    return x


def _multisine(rng: Rng, t: Array, stroke_m: float) -> Array:
    """Lines on a common raster with random phases; the amplitude falls with the frequency."""
    raster_hz, count = log_uniform(rng, 0.05, 0.3), int(rng.integers(4, 16))
    lines = raster_hz * rng.choice(np.arange(1, 31), count, replace=False)
    phases, falling = rng.uniform(0.0, 2.0 * pi, count), rng.uniform(0.7, 1.6)
    return np.asarray(np.sin(2.0 * pi * np.outer(t, lines) + phases) @ lines**-falling)


def _visited(rng: Rng, t: Array, targets: Array, fastest_m_s: float, rest_s: float) -> Array:
    """A motion controller: from target to target, each at its own speed, with rests."""
    times, places = [float(t[0])], [float(targets[0])]
    now = times[0] + BEFORE_S * rng.uniform(0.3, 1.3)
    for target in targets[1:].tolist():
        took_s = 1e-3 + abs(target - places[-1]) / (
            min(fastest_m_s, _FASTEST_M_S) * log_uniform(rng, 0.15, 1.0)
        )
        times += [now, now + took_s]
        places += [places[-1], target]
        now += took_s + rest_s * rng.uniform(0.2, 1.8)
    return np.interp(t, times, places)


def _steps(rng: Rng, t: Array, stroke_m: float) -> Array:
    return _visited(rng, t, rng.uniform(0.0, stroke_m, 200), 4.0 * stroke_m, rng.uniform(0.3, 1.5))


def _ramps(rng: Rng, t: Array, stroke_m: float) -> Array:
    """Triangles of several depths and speeds, hardly a rest."""
    targets = np.where(np.arange(200) % 2, rng.uniform(0.4, 1.0, 200), rng.uniform(0.0, 0.2, 200))
    return _visited(rng, t, targets * stroke_m, stroke_m * log_uniform(rng, 0.6, 3.0), 0.05)


def _pushes(rng: Rng, t: Array, stroke_m: float) -> Array:
    """Always forward, with holds; it never returns."""
    targets = np.linspace(0.0, stroke_m, int(rng.integers(5, 25)))
    length_s = float(t[-1] - t[0]) / len(targets)
    return _visited(rng, t, targets, 3.0 * stroke_m / len(targets) / length_s, 0.5 * length_s)


def _rests(rng: Rng, t: Array, stroke_m: float) -> Array:
    """A few strokes between long rests."""
    return _visited(rng, t, rng.uniform(0.0, stroke_m, 60), 2.0 * stroke_m, rng.uniform(1.5, 4.0))


PATHS: dict[str, Callable[[Rng, Array, float], Array]] = {
    "hand": _lognormal_strokes, "multisine": _multisine, "steps": _steps, "ramps": _ramps,
    "pushes": _pushes, "rests": _rests,
}  # fmt: skip
USUAL = ("hand", "hand", "hand", "multisine", "ramps", "ramps", "steps", "pushes", "rests")
"""Names of PATHS, as often as a laboratory records them."""
ODD = ("steps", "ramps", "rests", "pushes")
TREMOR_HZ = (8.0, 12.0)  # Hz, physiological tremor of a hand


def _tremor(rng: Rng, t: Array, size_m: float) -> Array:
    """Three lines close to each other, so that it comes and goes."""
    lines, phases = rng.uniform(*TREMOR_HZ, 3), rng.uniform(0.0, 2.0 * pi, 3)
    return np.asarray(size_m * np.sin(2.0 * pi * np.outer(t, lines) + phases).sum(axis=1) / np.sqrt(1.5))


def moved(rng: Rng, path: str, duration_s: float, stroke_m: float, tremor_m: float) -> Stage:
    """The path as the stage follows it: a servo of second order; positions from 0 (the sheath's mouth) up."""
    coarse = np.arange(-BEFORE_S, duration_s + 2.0 * AFTER_S, _COARSE_S)
    asked = PATHS[path](rng, coarse, stroke_m)
    asked = (asked - np.min(asked)) * stroke_m / float(np.ptp(asked)) + rng.uniform(0.0, 5e-3)
    asked += _tremor(rng, coarse, tremor_m)
    steps = np.arange(round((BEFORE_S + duration_s + AFTER_S) / STEP_S), dtype=np.float64)
    t = np.asarray(STEP_S * steps - BEFORE_S, dtype=np.float64)
    lag_s = 1.0 / (2.0 * pi * rng.uniform(15.0, 40.0))
    x = smoothed(smoothed(np.interp(t, coarse, asked), lag_s), lag_s)
    v = np.gradient(x, STEP_S)
    return Stage(t, x, v, np.gradient(v, STEP_S))
