"""Odd recordings with their pages.

3 to 10 s at 20 Hz to 2 kHz of a bench, of a force of two levels, of ramp and hold, each with up to three
things that go wrong in laboratories. A verdict with its page passes, and so does a refusal in one line; every
other exception, and a picture or a prediction that failed, does not.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from forefeel.common.errors import InputError
from forefeel.common.recording.recording import Recording
from forefeel.results.page import NOT_DRAWN
from forefeel.results.task import Task, examine
from tests.hidden_effects.bench import Population, draw
from tests.hidden_effects.bench.stage import Array, Rng, log_uniform
from tests.unit.diagnosis_samples import put

Samples = tuple[Array, Array, Array]
"""Stamps in s, position in m, force in N."""


def drawn(seed: int) -> Samples:
    """The same for the same seed."""
    rng = np.random.default_rng(seed)
    samples = list(BASES.values())[seed % len(BASES)](rng)
    for name in rng.choice(list(CHANGES), int(rng.integers(0, 4)), replace=False):
        samples = CHANGES[name](rng, *samples)
    return samples


def tried(seed: int, folder: Path) -> list[str]:
    """What failed on the page of the recording; nothing where an InputError refused it."""
    time_s, position_m, force_n = drawn(seed)
    try:
        file = put(folder / f"{seed}.csv", Recording(str(seed), time_s, position_m, force_n, str(seed)))
        result, page = examine(Task(file, as_is=True))
        text = page()
    except InputError:
        return []
    failed = [line for line in result.lines if line.startswith("Predicted   failed")]
    return failed + [line for line in text.splitlines() if NOT_DRAWN in line]


def _stamps(rng: Rng) -> Array:
    rate_hz = log_uniform(rng, 20.0, 2000.0)
    return np.asarray(np.arange(int(rng.uniform(3.05, 10.0) * rate_hz)) / rate_hz)


def _bench(rng: Rng) -> Samples:
    made = draw(Population.ODD, int(rng.integers(1_000_000)))
    return made.time_s, made.position_m, made.force_n


def _levels(rng: Rng) -> Samples:
    """A spring and a mass that a force of two levels sets swinging; an encoder of 1 um."""
    t = _stamps(rng)
    turns = np.sort(rng.uniform(0.0, t[-1], int(rng.integers(1, 9))))
    force = rng.uniform(-1.0, 1.0) + log_uniform(rng, 0.1, 10.0) * (np.searchsorted(turns, t) % 2)
    angle, pole = 2.0 * np.pi * log_uniform(rng, 0.5, 5.0) * t[1], np.exp(-rng.uniform(0.05, 3.0) * t[1])
    swing = [1.0, -2.0 * pole * np.cos(angle), pole**2]
    position = log_uniform(rng, 1e-4, 1e-2) * np.asarray(lfilter([sum(swing)], swing, force))
    return t, np.round(position, 6), np.asarray(force, dtype=np.float64)


def _hold(rng: Rng) -> Samples:
    """Ramp and hold of something that relaxes."""
    t = _stamps(rng)
    depth_m, ramp_s = log_uniform(rng, 2e-4, 3e-2), t[-1] * log_uniform(rng, 0.01, 0.3)
    position = depth_m * np.clip((t - rng.uniform(0.0, 0.2) * t[-1]) / ramp_s, 0.0, 1.0)
    pole = np.exp(-t[1] / log_uniform(rng, 0.05, 5.0))
    relaxing = lfilter([1.0, -1.0], [1.0, -pole], position)
    stiffness_n_m = log_uniform(rng, 10.0, 3000.0)
    force = stiffness_n_m * (position + rng.uniform(0.0, 2.0) * relaxing)
    return t, position, force + rng.normal(0.0, 1e-3 * np.ptp(force), len(t))


BASES: dict[str, Callable[[Rng], Samples]] = {"bench": _bench, "two levels": _levels, "hold": _hold}


def _coarse(rng: Rng, values: Array) -> Array:
    step = np.ptp(values) / log_uniform(rng, 2.0, 300.0)
    return values if step == 0.0 else np.asarray(step * np.round(values / step))


def _offset(rng: Rng, values: Array) -> Array:
    return np.asarray(values + rng.choice([-1.0, 1.0]) * log_uniform(rng, 10.0, 1e6) * np.ptp(values))


def _stuck(rng: Rng, values: Array) -> Array:
    """A reading that does not change for a while."""
    held, start = values.copy(), int(rng.integers(len(values)))
    held[start : start + int(rng.uniform(0.1, 0.9) * len(values))] = values[start]
    return held


def _clipped(rng: Rng, values: Array) -> Array:
    return np.clip(values, *np.quantile(values, (rng.uniform(0.0, 0.3), rng.uniform(0.6, 1.0))))


def _glitches(rng: Rng, values: Array) -> Array:
    rows = rng.integers(0, len(values), int(rng.integers(1, 6)))
    return np.asarray(values + np.isin(np.arange(len(values)), rows) * 30.0 * np.ptp(values))


def _uneven(rng: Rng, t: Array, x: Array, f: Array) -> Samples:
    """Polled: stamps that wander, with the position and the force of that instant."""
    times = t + rng.uniform(0.0, 0.9) * np.median(np.diff(t)) * rng.random(len(t))
    return times, np.interp(times, t, x), np.interp(times, t, f)


def _lossy(rng: Rng, t: Array, x: Array, f: Array) -> Samples:
    rows = rng.random(len(t)) > rng.uniform(0.05, 0.6)
    return t[rows], x[rows], f[rows]


def _gaps(rng: Rng, t: Array, x: Array, f: Array) -> Samples:
    """Nothing for a while, several times; the clock goes on."""
    lost = [(t > start) & (t < start + rng.uniform(0.1, 2.0)) for start in rng.uniform(0.0, t[-1], 3)]
    rows = ~np.logical_or.reduce(lost)
    return t[rows], x[rows], f[rows]


CHANGES: dict[str, Callable[[Rng, Array, Array, Array], Samples]] = {
    "flipped": lambda rng, t, x, f: (t, x, -f),
    "mirrored": lambda rng, t, x, f: (t, -x, f),
    "coarse position": lambda rng, t, x, f: (t, _coarse(rng, x), f),
    "coarse force": lambda rng, t, x, f: (t, x, _coarse(rng, f)),
    "far position": lambda rng, t, x, f: (t, _offset(rng, x), f),
    "far force": lambda rng, t, x, f: (t, x, _offset(rng, f)),
    "epoch": lambda rng, t, x, f: (t + 1.7e9, x, f),
    "position in other units": lambda rng, t, x, f: (t, x * log_uniform(rng, 1e-6, 1e6), f),
    "force in other units": lambda rng, t, x, f: (t, x, f * log_uniform(rng, 1e-6, 1e6)),
    "stuck position": lambda rng, t, x, f: (t, _stuck(rng, x), f),
    "stuck force": lambda rng, t, x, f: (t, x, _stuck(rng, f)),
    "clipped position": lambda rng, t, x, f: (t, _clipped(rng, x), f),
    "clipped force": lambda rng, t, x, f: (t, x, _clipped(rng, f)),
    "position glitches": lambda rng, t, x, f: (t, _glitches(rng, x), f),
    "force glitches": lambda rng, t, x, f: (t, x, _glitches(rng, f)),
    "position is noise": lambda rng, t, x, f: (t, np.ptp(x) * rng.standard_normal(len(x)), f),
    "one way": lambda rng, t, x, f: (t, np.maximum.accumulate(x), f),
    "uneven": _uneven,
    "lossy": _lossy,
    "gaps": _gaps,
}
