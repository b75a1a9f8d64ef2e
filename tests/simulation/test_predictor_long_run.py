"""90 s at 1 kHz of what an operating room does to an estimator: standstill, sine, other tissue, NaN.

The contact here imports nothing of ours: a spring, damper and mass with smooth friction and a bias, in numpy.
"""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.estimation.predictor import Predictor

Array = NDArray[np.float64]

RATE_HZ = 1000
DELAY = 300  # samples
PART = 15 * RATE_HZ
STILL, SINE, TISSUE, NANS, END = (parts * PART for parts in (1, 2, 3, 4, 6))
"""Where each part begins: standstill, pure sine, another tissue, NaN bursts. Multi-sine everywhere else."""


def _motion(n: NDArray[np.int64]) -> Array:
    """The stage's position in m; it comes to rest and leaves it without a jump."""
    t = n / RATE_HZ
    multi = sum(
        amplitude * (1 - np.cos(2 * np.pi * hertz * t + phase))
        for amplitude, hertz, phase in ((4e-3, 0.21, 0.0), (1.5e-3, 0.73, 1.0), (4e-4, 2.3, 2.0))
    )
    sine = 4e-3 * (1 - np.cos(2 * np.pi * 0.5 * t))
    still = _share(n, STILL, SINE)
    pure = _share(n, SINE, TISSUE)
    x = (1 - still) * ((1 - pure) * multi + pure * sine) + still * 5e-3
    return np.asarray(np.round(x / 1e-6) * 1e-6)  # the encoder


def _share(n: NDArray[np.int64], start: int, stop: int) -> Array:
    """1 from start to stop, 0 elsewhere, smooth over half a second at either end."""
    ramp = RATE_HZ // 2
    s = np.clip(np.minimum(n - start, stop - n) / ramp, 0.0, 1.0)
    return np.asarray(s * s * (3 - 2 * s))


def _force(n: NDArray[np.int64], x: Array, noise: Array) -> Array:
    """m, b, k, friction, bias; everything half as much again in the other tissue."""
    v = np.gradient(np.convolve(np.pad(x, 10, mode="edge"), np.ones(21) / 21, "valid")) * RATE_HZ
    factor = 1.0 + 0.5 * _share(n, TISSUE, 10 * END)
    return np.asarray(factor * (60.0 * x + 1.5 * v + 0.08 * np.tanh(v / 1e-3)) + 0.05 + noise)


def _run() -> Iterator[tuple[int, float, float]]:
    """(sample, position, force), a part at a time; in the NaN part 50 ms of each 7 s are no numbers."""
    rng = np.random.default_rng(7)
    for start in range(0, END, PART):
        n = np.arange(start, start + PART)
        x = _motion(n)
        f = _force(n, x, 0.01 * rng.standard_normal(PART))
        burst = (n >= NANS) & (n % (7 * RATE_HZ) < 50)
        f[burst] = np.nan
        x = np.where(burst & (n % (21 * RATE_HZ) < 50), np.inf, x)
        yield from zip(n.tolist(), x.tolist(), f.tolist(), strict=True)


@pytest.mark.timeout(300)
def test_predictor_after_standstill_is_as_good_as_before() -> None:
    predictor = Predictor()
    forces_n = np.full(END, np.nan)
    error_n = np.full(END, np.nan)
    predicted_n = np.full(END, np.nan)
    for n, position_m, force_n in _run():
        forces_n[n] = force_n
        if n >= DELAY:
            predictor.observe((n - DELAY) / RATE_HZ, float(forces_n[n - DELAY]))
        predictor.move(n / RATE_HZ, position_m)
        if (estimate := predictor.predict()) is not None:
            predicted_n[n] = estimate.force_n
            error_n[n] = abs(estimate.force_n - force_n)
    started = 5 * RATE_HZ
    assert np.isfinite(predicted_n[started:]).all()
    assert np.abs(predicted_n[started:]).max() < 2 * np.nanmax(np.abs(forces_n))

    def worst(start: int, stop: int) -> float:
        return float(np.nanmax(error_n[start:stop]))

    before_n = worst(STILL - PART // 2, STILL)
    assert worst(SINE + RATE_HZ, SINE + 5 * RATE_HZ) <= 1.5 * before_n  # a second to find its weights
    settled_n = float(np.sqrt(np.nanmean(error_n[NANS + PART :] ** 2)))
    fresh_n = float(np.sqrt(np.nanmean(error_n[STILL - PART // 2 : STILL] ** 2)))
    assert settled_n < 2.0 * fresh_n
