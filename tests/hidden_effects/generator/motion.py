"""Motions of the stage on a grid of 10 kHz, with their exact or finely differenced derivatives."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np

from tests.hidden_effects.generator.scan import Array

RATE_HZ = 10_000.0
STEP_S = 1.0 / RATE_HZ
BEFORE_S = 1.0
"""What has memory runs for so long before the record starts."""


@dataclass(frozen=True)
class Motion:
    """Time, position, velocity, acceleration on a uniform grid; the record starts at time 0.

    `inserted` positions are not negative, others lie about 0.
    """

    t: Array
    x: Array
    v: Array
    a: Array

    @property
    def step_s(self) -> float:
        return float(self.t[1] - self.t[0])

    def thinned(self, every: int) -> "Motion":
        return Motion(self.t[::every], self.x[::every], self.v[::every], self.a[::every])


def grid(duration_s: float) -> Array:
    """From BEFORE_S before the record to its end and a little further."""
    first, last = -round(BEFORE_S * RATE_HZ), round((duration_s + 0.01) * RATE_HZ)
    return np.asarray(np.arange(first, last) * STEP_S, dtype=np.float64)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sum_of_sines(t: Array, amplitudes: Array, frequencies: Array, phases: Array) -> Motion:
    x, v, a = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for amplitude, frequency, phase in zip(amplitudes, frequencies, phases, strict=True):
        omega = 2.0 * pi * frequency
        sine = amplitude * np.sin(omega * t + phase)
        x += sine
        v += amplitude * omega * np.cos(omega * t + phase)
        a -= omega * omega * sine
    return Motion(t, x, v, a)


def _moved(motion: Motion, offset: float, scale: float = 1.0) -> Motion:
    return Motion(motion.t, scale * motion.x + offset, scale * motion.v, scale * motion.a)


def _minimum_jerk(t: Array, start_s: float, took_s: float, way: float) -> Motion:
    """One stroke, zero before, `way` after (Flash and Hogan, J. Neurosci. 5(7), 1985)."""
    s = np.clip((t - start_s) / took_s, 0.0, 1.0)
    x = way * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    v = way / took_s * 30.0 * (s * (1.0 - s)) ** 2
    a = way / took_s**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
    return Motion(t, x, v, a)


def _strokes(rng: np.random.Generator, t: Array) -> Motion:
    """Minimum-jerk strokes of varying length and speed with and without dwells."""
    reach = rng.uniform(8e-3, 40e-3)
    slowest, rest_share = log_uniform(rng, 3e-3, 12e-3), rng.uniform(0.1, 0.5)
    x, v, a = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    now, at = float(t[0]) + rng.uniform(0.0, 0.5), 0.0
    while now < t[-1]:
        target = rng.uniform(0.0, reach)
        if abs(target - at) < 0.08 * reach:
            continue
        took = max(0.25, abs(target - at) / log_uniform(rng, slowest, 80e-3))
        first, last = np.searchsorted(t, (now, now + took))
        stroke = _minimum_jerk(t[first:last], now, took, target - at)
        x[first:last] = at + stroke.x
        v[first:last] += stroke.v
        a[first:last] += stroke.a
        x[last:] = target
        now, at = now + took, target
        if rng.random() < rest_share:
            now += rng.uniform(0.1, 1.5)
    return Motion(t, x, v, a)


def _tremor(rng: np.random.Generator, t: Array) -> Motion:
    """Physiological tremor, 6 to 12 Hz; its beats come from close lines. One hand in five has none."""
    count = int(rng.integers(3, 6))
    size = 0.0 if rng.random() < 0.2 else log_uniform(rng, 10e-6, 120e-6)
    amplitudes = size * rng.uniform(0.5, 1.5, count) * np.sqrt(2.0 / count)
    return _sum_of_sines(t, amplitudes, rng.uniform(6.0, 12.0, count), rng.uniform(0.0, 2.0 * pi, count))


def hand(rng: np.random.Generator, t: Array) -> Motion:
    """Strokes with dwells and reversals, tremor on top."""
    strokes, tremor = _strokes(rng, t), _tremor(rng, t)
    return Motion(t, strokes.x + tremor.x, strokes.v + tremor.v, strokes.a + tremor.a)


def multisine(rng: np.random.Generator, t: Array) -> Motion:
    """8 to 20 lines between 0.05 and 8 Hz, amplitudes falling with frequency, random phases."""
    count = int(rng.integers(8, 21))
    frequencies = np.exp(rng.uniform(np.log(0.05), np.log(8.0), count))
    frequencies[:2] = rng.uniform(0.1, 1.0), rng.uniform(2.0, 8.0)
    amplitudes = rng.uniform(0.5, 1.5, count) * frequencies ** -rng.uniform(0.8, 1.3)
    motion = _sum_of_sines(t, amplitudes, frequencies, rng.uniform(0.0, 2.0 * pi, count))
    return _moved(motion, 0.0, rng.uniform(2e-3, 8e-3) / float(np.std(motion.x)))


def sweep(rng: np.random.Generator, t: Array) -> Motion:
    """Three to five logarithmic sweeps one after the other, each with its own amplitude."""
    count = int(rng.integers(3, 6))
    length = (t[-1] - t[0]) / count
    slow, fast, largest = rng.uniform(0.1, 0.4), rng.uniform(2.0, 6.0), rng.uniform(6e-3, 15e-3)
    levels = rng.permutation(np.linspace(0.2, 1.0, count)) * largest
    segment = np.minimum(((t - t[0]) / length).astype(int), count - 1)
    inside = (t - t[0]) - segment * length
    frequency = slow * (fast / slow) ** (inside / length)
    phase = 2.0 * pi * length / np.log(fast / slow) * (frequency - slow)
    edge = np.clip(np.minimum(inside, length - inside) / (0.1 * length), 0.0, 1.0)
    window = edge**3 * (10.0 - 15.0 * edge + 6.0 * edge * edge)
    x = levels[segment] * window * np.sin(phase) / (1.0 + frequency)
    v = np.gradient(x, t)
    return Motion(t, x, v, np.gradient(v, t))


def pure_sine(rng: np.random.Generator, t: Array) -> Motion:
    amplitude, frequency = rng.uniform(3e-3, 12e-3), log_uniform(rng, 0.3, 2.5)
    return _sum_of_sines(t, np.array([amplitude]), np.array([frequency]), rng.uniform(0.0, 2.0 * pi, 1))


def constant_speed(rng: np.random.Generator, t: Array) -> Motion:
    speed = log_uniform(rng, 0.5e-3, 3e-3)
    return Motion(t, speed * (t - t[0]), np.full_like(t, speed), np.zeros_like(t))


def standstill(rng: np.random.Generator, t: Array) -> Motion:
    return Motion(t, np.full_like(t, rng.uniform(1e-3, 20e-3)), np.zeros_like(t), np.zeros_like(t))


MOTIONS: dict[str, Callable[[np.random.Generator, Array], Motion]] = {
    "hand": hand,
    "multisine": multisine,
    "sweep": sweep,
    "pure_sine": pure_sine,
    "constant_speed": constant_speed,
    "standstill": standstill,
}
RICH = ("hand", "multisine", "sweep")
"""Motions that separate; drawn with the weights of WEIGHTS."""
WEIGHTS = (0.6, 0.25, 0.15)


def drawn_motion(rng: np.random.Generator, kind: str, duration_s: float, inserted: bool) -> Motion:
    """A motion of that kind, placed from 0 upwards when inserted, else about 0."""
    motion = MOTIONS[kind](rng, grid(duration_s))
    low, high = float(np.min(motion.x)), float(np.max(motion.x))
    if kind in ("constant_speed", "standstill"):
        return motion
    return _moved(motion, rng.uniform(0.0, 2e-3) - low if inserted else -0.5 * (low + high))
