"""Forces along a motion, and what a bench adds that nobody models."""

from collections.abc import Sequence
from itertools import pairwise
from math import pi

import numpy as np
from scipy.signal import lfilter

from tests.hidden_effects.laboratory.motion import Motion, Rng, log_uniform
from tests.hidden_effects.laboratory.truth import Array


def bristle(x: Array, length: float) -> Array:
    """Share of the full friction, -1 to 1, that builds up over `length` after a reversal (Dahl, 1968).

    Exact on monotone stretches; at rest it stays as it was.
    """
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x))) != 0) + 1
    u, last = np.zeros_like(x), 0.0
    for start, stop in pairwise([0, *turns.tolist(), len(x) - 1]):
        way = x[start : stop + 1] - x[start]
        side = float(np.sign(way[-1])) if len(way) else 0.0
        u[start : stop + 1] = side - (side - last) * np.exp(-np.abs(way) / length) if side else last
        last = float(u[stop])
    return u


def stribeck(m: Motion, length: float, ratio: float, speed: float) -> Array:
    """As `bristle`, `ratio` times larger at rest and falling with the speed."""
    return np.asarray(bristle(m.x, length) * (1.0 + (ratio - 1.0) * np.exp(-((m.v / speed) ** 2))))


def maxwell(m: Motion, tau_s: float, rate: Array | None = None) -> Array:
    """Stretch of the spring of a Maxwell branch, z' = x' - z/tau."""
    pole = float(np.exp(-(m.t[1] - m.t[0]) / tau_s))
    rate = m.v if rate is None else rate
    return np.asarray(lfilter([tau_s * (1.0 - pole)], [1.0, -pole], rate))


def relaxing(m: Motion, branches: Sequence[tuple[float, float]], rate: Array | None = None) -> Array:
    """Force of Maxwell branches (stiffness, time constant) along x', or along `rate`."""
    return np.asarray(sum((k * maxwell(m, tau_s, rate) for k, tau_s in branches), np.zeros_like(m.t)))


def played(x: Array, gap: float) -> Array:
    """Position behind a play of that width, held by what is behind."""
    half, y, out = 0.5 * gap, float(x[0]), []
    for now in x.tolist():
        y = min(max(y, now - half), now + half)
        out.append(y)
    return np.array(out)


def yielding(x: Array, stiffness: float, limit: float, hardening: float) -> Array:
    """Spring that yields plastically at a force that grows with the plastic way (one-sided memory)."""
    plastic, way, out = float(x[0]), 0.0, []
    for now in x.tolist():
        trial = stiffness * (now - plastic)
        over = abs(trial) - limit - hardening * way
        if over > 0.0:
            slip = over / (stiffness + hardening)
            plastic, way = plastic + (slip if trial > 0.0 else -slip), way + slip
        out.append(stiffness * (now - plastic))
    return np.array(out)


def preisach(rng: Rng, x: Array, low: float, high: float) -> Array:
    """Mean of 80 relays with thresholds between `low` and `high` (Preisach, 1935), -1 to 1."""
    total = np.zeros_like(x)
    for _ in range(80):
        down, up = np.sort(rng.uniform(low, high, 2))
        state = np.where(x > up, 1.0, np.where(x < down, -1.0, 0.0))
        known = np.maximum.accumulate(np.where(state != 0.0, np.arange(len(x)), 0))
        total += np.where(state[known] == 0.0, -1.0, state[known])
    return np.asarray(total / 80.0)


def bumps(rng: Rng, x: Array, low: float, high: float, count: int) -> Array:
    """Aperiodic force over position: bumps of random place, width and sign; rms about 1."""
    total, span = np.zeros_like(x), high - low
    for _ in range(count):
        width = span / count * log_uniform(rng, 0.3, 1.5)
        total += rng.normal() * np.exp(-0.5 * ((x - rng.uniform(low, high)) / width) ** 2)
    return total


def wandering(rng: Rng, t: Array, corner_hz: float) -> Array:
    """Slow random course of unit rms, of frequencies up to about `corner_hz`."""
    knots = max(4, int(4.0 * corner_hz * t[-1]))
    values = np.convolve(rng.normal(size=knots + 4), np.hanning(7)[1:-1], "valid")
    course = np.interp(t, np.linspace(t[0], t[-1], len(values)), values)
    return np.asarray((course - np.mean(course)) / (np.std(course) + 1e-12))


def noise(rng: Rng, count: int) -> Array:
    """White, pink, or low-passed by the cell's amplifier; unit rms."""
    white = rng.normal(size=count)
    form = rng.choice(["white", "pink", "filtered"], p=[0.5, 0.25, 0.25])
    if form == "filtered":
        pole = rng.uniform(0.3, 0.9)
        white = lfilter([1.0 - pole], [1.0, -pole], white)
    if form == "pink":
        spectrum = np.fft.rfft(white)
        white = np.fft.irfft(spectrum / np.sqrt(np.arange(len(spectrum)) + 3.0), count)
    return np.asarray(white / np.std(white))


class Rest:
    """What is left on a bench: wandering, a ripple over position, fluctuating friction, a tare that jumps.

    The ripple and the shares are of the world, the same in both motions; wandering and tare are of a run.
    """

    def __init__(self, rng: Rng, travel: float) -> None:
        self._corner_hz, self._travel = log_uniform(rng, 0.02, 0.5), travel
        self._shares = rng.dirichlet([1.0, 0.8, 0.8])
        self._waves = [(travel / rng.uniform(1.5, 40.0), rng.uniform(0.0, 6.3)) for _ in range(3)]
        self._tare = 0.5 if rng.random() < 0.15 else 0.0

    @property
    def ripple(self) -> float:
        """Its part that is a map over position, of about the rms of all."""
        return float(self._shares[1] / np.linalg.norm(self._shares))

    def along(self, rng: Rng, m: Motion) -> Array:
        """One run's rest, unit rms."""
        ripple = sum(
            (np.sin(2.0 * pi * m.x / pitch + phase) for pitch, phase in self._waves), np.zeros(len(m.t))
        )
        rubs = bristle(m.x, 0.01 * self._travel) * wandering(rng, m.t, 4.0 * self._corner_hz)
        parts = (wandering(rng, m.t, self._corner_hz), ripple, rubs)
        total = sum(
            (share * part / (np.std(part) + 1e-9) for share, part in zip(self._shares, parts, strict=True))
        )
        total = total + self._tare * (m.t > m.t[-1] * rng.uniform(0.2, 0.8))
        total = np.asarray(total - np.mean(total))
        return np.asarray(total / (np.std(total) + 1e-12))
