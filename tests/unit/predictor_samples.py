"""Motion, contact and delivery for tests of the predictor; numpy only, nothing of ours."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.predictor import Predictor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sample:
    """Stamps in s, positions in m, forces in N; all of shape (n,)."""

    t: Array
    x: Array
    f: Array


@dataclass(frozen=True)
class Said:
    """By sample: prediction, band, and the newest force that had arrived; NaN where there was none."""

    force: Array
    low: Array
    high: Array
    held: Array
    leading: tuple[str, ...]

    def rms(self, true: Array, rows: NDArray[np.bool_]) -> float:
        return float(np.sqrt(np.mean((self.force - true)[rows] ** 2)))

    def zoh_rms(self, true: Array, rows: NDArray[np.bool_]) -> float:
        return float(np.sqrt(np.mean((self.held - true)[rows] ** 2)))


def moved(duration_s: float, rate_hz: float) -> tuple[Array, Array]:
    """Stamps, and a motion of several sines, some 10 mm from end to end."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    sines = ((4e-3, 0.21, 0.0), (1.5e-3, 0.73, 1.0), (4e-4, 2.3, 2.0))
    return t, 0.01 + np.sum([a * np.sin(2 * np.pi * hz * t + p) for a, hz, p in sines], axis=0)


def contact(duration_s: float = 20.0, rate_hz: float = 200.0, seed: int = 0, changed: float = 1.0) -> Sample:
    """Spring, damper, friction, bias, noise; stiffer by `changed` in the second half."""
    rng = np.random.default_rng(seed)
    t, x = moved(duration_s, rate_hz)
    v = np.gradient(x, t)
    k = np.where(t < duration_s / 2, 1.0, changed)
    f = k * (60.0 * x + 1.5 * v + 0.08 * np.tanh(v / 1e-3)) + 0.05
    noise = rng.standard_normal((2, len(t)))
    return Sample(t, x + 1e-6 * noise[0], f + 3e-3 * noise[1])


def replayed(
    sample: Sample,
    delay_s: float,
    arrival_s: Array | None = None,
    model: ContactModel | None = None,
    prior: ContactPrior | None = None,
) -> Said:
    """Every force as it arrives, `delay_s` late or at `arrival_s` (inf: lost); motion; question."""
    arrival = sample.t + delay_s if arrival_s is None else arrival_s
    order = np.argsort(arrival, kind="stable").tolist()
    t, x, f = sample.t.tolist(), sample.x.tolist(), sample.f.tolist()
    predictor, said, held, leading = Predictor(model, prior), [], [], []
    newest, at = (-np.inf, np.nan), 0
    for n, now in enumerate(t):
        while at < len(order) and arrival[order[at]] <= now + 1e-9:
            k = order[at]
            at += 1
            predictor.observe(t[k], f[k])
            newest = max(newest, (t[k], f[k])) if np.isfinite(f[k]) else newest
        predictor.move(now, x[n])
        estimate = predictor.predict()
        said.append((np.nan,) * 3 if estimate is None else estimate[:3])
        leading.append("" if estimate is None else estimate.leading)
        held.append(newest[1])
    columns = np.array(said)
    return Said(columns[:, 0], columns[:, 1], columns[:, 2], np.array(held), tuple(leading))


def scored(sample: Sample, delay_s: float) -> NDArray[np.bool_]:
    """From 3 s + delay on."""
    return np.asarray(sample.t - sample.t[0] >= 3.0 + delay_s)


def drifting(x: Array, t: Array, seed: int) -> Sample:
    """A force that wanders on its own, whatever the motion does, and a noisy position."""
    rng = np.random.default_rng(seed)
    step, keep = 3e-3 / np.sqrt((t[1] - t[0]) * 1e4), np.exp(-(t[1] - t[0]) / 2.0)
    walk, innovations = np.zeros(len(t)), rng.standard_normal(len(t))
    for n in range(1, len(t)):
        walk[n] = keep * walk[n - 1] + step * innovations[n]
    noise = rng.standard_normal((2, len(t)))
    return Sample(t, x + 2e-6 * noise[0], 0.02 + walk + 1e-3 * noise[1])
