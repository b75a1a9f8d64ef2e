"""Rhythms of a patient, a second axis, and other courses in time of a recording, each of unit size."""

from math import pi

import numpy as np

from tests.hidden_effects.laboratory.forces import bristle, wandering
from tests.hidden_effects.laboratory.motion import Motion, Rng, log_uniform, strokes
from tests.hidden_effects.laboratory.truth import Array


class Rhythm:
    """Heart or breath with four harmonics, whose rate wanders by a share of it; unit rms."""

    def __init__(self, rng: Rng, hz: float, varies: float) -> None:
        self.hz, self.varies = hz, varies
        self._sizes = np.array([1.0, *(rng.uniform(0.2, 0.8) ** n for n in (1, 2, 3))])
        self._phases = rng.uniform(0.0, 2.0 * pi, 4)
        self._corner_hz = 0.15 * hz * log_uniform(rng, 0.5, 1.5)

    def along(self, rng: Rng, t: Array) -> Array:
        """One run of it, which begins anywhere in the rhythm."""
        rate = self.hz * np.maximum(1.0 + self.varies * wandering(rng, t, self._corner_hz), 0.3)
        turns = np.cumsum(rate) * (t[1] - t[0]) + rng.random()
        parts = zip(self._sizes, self._phases, strict=True)
        wave = np.zeros_like(t)
        for n, (size, phase) in enumerate(parts):
            wave += size * np.sin(2.0 * pi * (n + 1) * turns + phase)
        return np.asarray(wave / np.std(wave))


def rolled(rng: Rng, t: Array, most_rad: float) -> Array:
    """Roll of the holder by a hand, or turning on and on with rests."""
    lasts_s = (log_uniform(rng, 0.4, 1.5), log_uniform(rng, 1.6, 5.0))
    way = 0.5 * most_rad * strokes(rng, t, lasts_s, rng.uniform(0.2, 0.8), True)
    if rng.random() < 0.3:
        way = np.cumsum(np.abs(np.gradient(way)))
    return np.asarray(way)


class Settling:
    """Exponential drift beside a slow wave of the room."""

    def __init__(self, rng: Rng, lasts_s: float) -> None:
        self.settles_s, self._period_s = (log_uniform(rng, *(lasts_s * s for s in each))
                                          for each in ((0.06, 0.3), (0.3, 1.2)))  # fmt: skip
        self._wave, self._sign = rng.uniform(0.05, 0.25), float(rng.choice([-1.0, 1.0]))

    def along(self, rng: Rng, t: Array) -> Array:
        wave = self._wave * np.sin(2.0 * pi * t / self._period_s + rng.uniform(0.0, 2.0 * pi))
        return np.asarray(self._sign * np.exp(-t / self.settles_s) + wave)


def whirl(rng: Rng, m: Motion, hz: float) -> Array:
    """Swings with that frequency while the stage moves, at a phase of its own each time."""
    rate = hz * (1.0 + 0.04 * wandering(rng, m.t, 0.5))
    moving = np.tanh(np.abs(m.v) / (0.3 * np.quantile(np.abs(m.v), 0.8) + 1e-9))
    return np.asarray(moving * np.sin(2.0 * pi * np.cumsum(rate) * (m.t[1] - m.t[0]) + rng.uniform(0.0, 6.3)))


def restless(rng: Rng, m: Motion, length_m: float, hz: float) -> Array:
    """Dry friction whose size wanders."""
    return np.asarray(bristle(m.x, length_m) * np.abs(1.0 + 0.9 * wandering(rng, m.t, hz)))


def bumps(m: Motion, inward: tuple[float, float], outward: tuple[float, float], width_m: float) -> Array:
    """A bump each (place, size) on the way in and on the way out."""
    side = 0.5 * (1.0 + bristle(m.x, 0.3 * width_m))
    hill = [size * np.exp(-0.5 * ((m.x - place) / width_m) ** 2) for place, size in (inward, outward)]
    return np.asarray(side * hill[0] + (1.0 - side) * hill[1])
