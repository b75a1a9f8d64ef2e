"""Motions of laboratories on a fine grid: position and its derivatives, smoothed as a drive smooths them."""

from math import pi
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from tests.hidden_effects.laboratory.truth import Array

Rng = np.random.Generator
OVER = 10  # steps of the grid per sample
MOST, FEWEST = 20_000, 450  # samples of a recording


class Motion(NamedTuple):
    """Time, position, velocity and acceleration on a grid of OVER steps per sample."""

    t: Array
    x: Array
    v: Array
    a: Array


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def grid(rng: Rng, rates_hz: tuple[float, float], lasts_s: tuple[float, float]) -> tuple[float, Array]:
    """Sampling rate, and times on the fine grid, within the count of samples allowed."""
    rate_hz = log_uniform(rng, *rates_hz)
    if rng.random() < 0.7:  # usual settings of an instrument
        usual = np.array([1, 2, 5, 10, 20, 25, 30, 50, 62.5, 100, 125, 200, 250, 500, 1000])
        rate_hz = float(usual[np.argmin(np.abs(np.log(usual / rate_hz)))])
    last_s = float(np.clip(log_uniform(rng, *lasts_s), FEWEST / rate_hz, MOST / rate_hz))
    return rate_hz, np.arange(round(last_s * rate_hz) * OVER) / (rate_hz * OVER)


def moved(t: Array, x: Array, settles_s: float = 0.0) -> Motion:
    """A motion along x as a drive with that settling time follows it, from rest."""
    step = float(t[1] - t[0])
    if settles_s > 0.0:
        pole = float(np.exp(-3.0 * step / settles_s))
        for _ in range(3):
            x = lfilter([1.0 - pole], [1.0, -pole], x, zi=[pole * x[0]])[0]
    v = np.gradient(x, step)
    return Motion(t, x, v, np.gradient(v, step))


def multisine(rng: Rng, t: Array, low_hz: float, top_hz: float) -> Array:
    """Lines on a raster up to `top_hz`, random phases, falling amplitudes; the largest deflection is 1."""
    count = int(rng.integers(3, 10))
    lines_hz = low_hz * np.unique(np.round(np.geomspace(1.0, top_hz / low_hz, count)))
    fall, x = rng.uniform(0.5, 1.5), np.zeros_like(t)
    for line_hz in lines_hz:
        x += (low_hz / line_hz) ** fall * np.sin(2.0 * pi * line_hz * t + rng.uniform(0.0, 2.0 * pi))
    return np.asarray(x / np.max(np.abs(x)))


def chirped(rng: Rng, t: Array, low_hz: float, top_hz: float, flat: float) -> Array:
    """Sweeps from `low_hz` to `top_hz`, each from and to rest; the amplitude falls as frequency to the power
    -flat.
    """
    sweeps = int(rng.integers(1, 4))
    share = (t * sweeps / (t[-1] + t[1])) % 1.0
    hz = low_hz * (top_hz / low_hz) ** share if rng.random() < 0.5 else low_hz + (top_hz - low_hz) * share
    if rng.random() < 0.3:
        hz = hz[::-1]
    swell = np.sin(0.5 * pi * np.clip(15.0 * np.minimum(share, 1.0 - share), 0.0, 1.0)) ** 2
    return np.asarray(swell * np.sin(2.0 * pi * np.cumsum(hz) * (t[1] - t[0])) * (low_hz / hz) ** flat)


def visited(t: Array, stops: list[tuple[float, float]], smooth: bool) -> Array:
    """Position along (time, place): by constant speed, or with the least jerk as a hand moves."""
    times, places = np.array(stops).T
    if not smooth:
        return np.asarray(np.interp(t, times, places))
    leg = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
    p = np.clip((t - times[leg]) / (times[leg + 1] - times[leg]), 0.0, 1.0)
    return np.asarray(places[leg] + np.diff(places)[leg] * p**3 * (10.0 - 15.0 * p + 6.0 * p**2))


def strokes(
    rng: Rng, t: Array, lasts_s: tuple[float, float], rests: float, hand: bool, back: bool = False
) -> Array:
    """Strokes in -1 to 1, or (`back`) from -1 to a place and back; `rests`: share with rests."""
    now, here = float(rng.uniform(0.2, 1.0)) * lasts_s[0], -1.0
    stops = [(0.0, here), (now, here)]
    size = rng.uniform(0.2, 1.0)  # of the strokes, changes along the recording
    while now < t[-1]:
        size = float(np.clip(size * log_uniform(rng, 0.7, 1.5), 0.15, 1.0))
        home = back and here > -0.9
        away = rng.uniform(0.3, 1.0) if back else (-np.sign(here + 1e-9) * rng.uniform(0.5, 1.0))
        there = -1.0 if home else (2.0 * size * away - 1.0 if back else size * away)
        now += max(log_uniform(rng, *lasts_s), 1e-3)
        stops.append((now, float(there)))
        here = float(there)
        if rng.random() < rests:
            now += log_uniform(rng, *lasts_s) * rng.uniform(0.3, 2.0)
            stops.append((now, here))
    x = visited(t, stops, hand)
    return np.asarray(2.0 * (x - np.min(x)) / np.ptp(x) - 1.0)


def tremor(rng: Rng, t: Array, size: float) -> Array:
    """Of a hand at 7 to 11 Hz, with an amplitude that comes and goes."""
    swell = 1.0 + np.sin(2.0 * pi * rng.uniform(0.05, 0.3) * t + rng.uniform(0.0, 6.0))
    return np.asarray(size * swell * np.sin(2.0 * pi * rng.uniform(7.0, 11.0) * t + swell))
