"""How a bench measures: stamps, the encoder, the load cell with its chain and its noise."""

from dataclasses import dataclass, replace
from math import inf, pi
from typing import Any, NamedTuple, cast

import numpy as np

from tests.hidden_effects.bench.rig import Rig, simulated
from tests.hidden_effects.bench.stage import STEP_S, Array, Rng, Stage, log_uniform, smoothed

NOISES = ("white", "pink", "slow", "white+slow", "pink+slow")
"""Forms of the force's noise; `slow` has a corner of about 1 Hz."""
_SLOW_HZ = (0.5, 2.0)  # Hz, range of that corner
_COARSE_HZ = 100.0  # Hz, raster on which slow wandering is drawn
_HUM_SHARES = (1.0, 0.15, 0.3)  # of the mains' first three harmonics: the third is larger, as of rectifiers


class Sensor(NamedTuple):
    """The load cell's chain. `wander_n` and `gain` are on the fine grid."""

    bias_n: float = 0.0
    lag_s: float = 0.0
    delay_s: float = 0.0
    rate_n_s: float = 0.0
    limit_n: float = inf
    step_n: float = 0.0
    spike_hz: float = 0.0
    spike_n: float = 0.0
    hum_hz: float = 0.0
    hum_n: float = 0.0
    wander_n: Array | None = None
    gain: Array | None = None


class Take(NamedTuple):
    """One recording's instants and luck, in words, too: the same with and without an effect."""

    time_s: Array
    rate_hz: float
    noise_n: Array
    encoder_m: float
    seed: int
    words: str

    @property
    def noise_rms_n(self) -> float:
        return float(np.std(self.noise_n))


@dataclass(frozen=True)
class Bench:
    """`force_n` and `peak_n` are std and maximum of the force of mass, damper and spring alone, for scale."""

    stage: Stage
    rig: Rig
    sensor: Sensor
    duration_s: float
    noise_rms_n: float
    force_n: float
    peak_n: float
    push_n: Array | None = None
    heave_m: Array | None = None

    @property
    def reach_m(self) -> float:
        return float(np.ptp(self.stage.x))

    def with_rig(self, **fields: object) -> "Bench":
        return replace(self, rig=self.rig._replace(**_any(fields)))

    def with_wall(self, **fields: object) -> "Bench":
        return self.with_rig(wall=self.rig.wall._replace(**_any(fields)))

    def with_tip(self, **fields: object) -> "Bench":
        return self.with_rig(bodies=(*self.rig.bodies[:-1], self.rig.bodies[-1]._replace(**_any(fields))))

    def with_sensor(self, **fields: object) -> "Bench":
        return replace(self, sensor=self.sensor._replace(**_any(fields)))


def _any(fields: dict[str, object]) -> dict[str, Any]:
    return cast("dict[str, Any]", fields)


def encoded(bench: Bench, take: Take) -> Array:
    return np.asarray(np.round(bench.stage.at(take.time_s)[0] / take.encoder_m) * take.encoder_m)


def read(bench: Bench, take: Take) -> Array:
    sensor, stage = bench.sensor, bench.stage
    force_n = simulated(bench.rig, stage, bench.push_n, bench.heave_m).cell_n
    force_n = force_n if sensor.gain is None else force_n * sensor.gain
    force_n = force_n if sensor.wander_n is None else force_n + sensor.wander_n
    force_n = smoothed(force_n, sensor.lag_s) if sensor.lag_s > 0.0 else force_n
    sampled = np.interp(take.time_s - sensor.delay_s, stage.t, force_n)
    sampled += sensor.bias_n + sensor.rate_n_s * take.time_s + take.noise_n + _disturbed(sensor, take)
    limited = np.clip(sampled, -sensor.limit_n, sensor.limit_n)
    return np.round(limited / sensor.step_n) * sensor.step_n if sensor.step_n > 0.0 else limited


def _disturbed(sensor: Sensor, take: Take) -> Array:
    """Mains hum, spikes of one to three samples."""
    rng = np.random.default_rng(take.seed)
    turns, phases = sensor.hum_hz * take.time_s, rng.uniform(0.0, 2.0 * pi, 3)
    added = np.zeros_like(take.time_s)
    for n, share in enumerate(_HUM_SHARES):
        added += sensor.hum_n * share * np.sin(2.0 * pi * (n + 1) * turns + phases[n])
    hits = np.flatnonzero(rng.random(len(added)) < sensor.spike_hz / take.rate_hz)
    for hit in hits.tolist():
        added[hit : hit + int(rng.integers(1, 4))] += (
            sensor.spike_n * rng.uniform(0.5, 1.5) * rng.choice((-1, 1))
        )
    return added


def noise(rng: Rng, kind: str, count: int, rate_hz: float, rms_n: float) -> Array:
    """A sum of the named forms, of equal rms each."""
    parts = [_FORMS[form](rng, count, rate_hz) for form in kind.split("+")]
    total = np.sum([part / np.std(part) for part in parts], axis=0)
    return np.asarray(rms_n * (total - np.mean(total)) / np.std(total))


def _white(rng: Rng, count: int, rate_hz: float) -> Array:
    return rng.standard_normal(count)


def _pink(rng: Rng, count: int, rate_hz: float) -> Array:
    """1 / f in power down to the recording's own length."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0.0
    pink: Array = np.fft.irfft(spectrum, count)
    return pink


def _slow(rng: Rng, count: int, rate_hz: float) -> Array:
    """White noise through a first-order low-pass."""
    return smoothed(rng.standard_normal(count), 1.0 / (2.0 * pi * rng.uniform(*_SLOW_HZ)), 1.0 / rate_hz)


_FORMS = {"white": _white, "pink": _pink, "slow": _slow}


def wandering(rng: Rng, stage: Stage, corner_hz: float) -> Array:
    """A smooth random function of time with an rms of 1 on the fine grid."""
    coarse = np.arange(stage.t[0], stage.t[-1] + 0.1, 1.0 / _COARSE_HZ)
    lag_s = 1.0 / (2.0 * pi * corner_hz)
    path = smoothed(rng.standard_normal(len(coarse)), lag_s, 1.0 / _COARSE_HZ)
    path = smoothed(path, lag_s, 1.0 / _COARSE_HZ)
    return np.asarray(np.interp(stage.t, coarse, (path - np.mean(path)) / np.std(path)), dtype=np.float64)


def walking(rng: Rng, stage: Stage) -> Array:
    """A random walk with an rms of 1 on the fine grid."""
    path = np.cumsum(rng.standard_normal(len(stage.t)) * np.sqrt(STEP_S))
    return np.asarray((path - np.mean(path)) / np.std(path))


def stamps(rng: Rng, kind: str, duration_s: float, rate_hz: float) -> Array:
    """`even`; `jittered` instants; `dropped` samples, singly and up to five in a row. Rounded to 10 us."""
    regular = np.arange(int(duration_s * rate_hz)) / rate_hz
    if kind == "jittered":
        regular = regular + rng.uniform(0.0, rng.uniform(0.02, 0.4), len(regular)) / rate_hz
    kept = np.ones(len(regular), dtype=bool)
    if kind == "dropped":
        for first in np.flatnonzero(rng.random(len(regular)) < log_uniform(rng, 1e-3, 2e-2)).tolist():
            kept[first : first + int(rng.integers(1, 6))] = False
    return np.asarray(np.round(regular[kept], 5))
