"""A minute of what an operating room does to an estimator: standstill, one sine, other tissue, no numbers."""

import numpy as np

from tests.unit.predictor_samples import Array, Sample, moved, replayed

RATE_HZ, DELAY_S = 200.0, 0.3
STILL_S, SINE_S, TISSUE_S, NANS_S, END_S = 10.0, 20.0, 30.0, 40.0, 60.0
"""Where each part begins: standstill, one sine, another tissue, NaN bursts. Several sines everywhere else."""


def share(t: Array, start_s: float, stop_s: float) -> Array:
    """1 from start to stop, 0 elsewhere, smooth over half a second at either end."""
    s = np.clip(np.minimum(t - start_s, stop_s - t) / 0.5, 0.0, 1.0)
    return np.asarray(s * s * (3 - 2 * s))


def test_predictor_after_standstill_is_as_good_as_before() -> None:
    rng = np.random.default_rng(7)
    t, sines = moved(END_S, RATE_HZ)
    still, pure = share(t, STILL_S, SINE_S), share(t, SINE_S, TISSUE_S)
    sine = 4e-3 * (1.0 - np.cos(np.pi * t))
    x = np.round((1.0 - still) * ((1.0 - pure) * sines + pure * sine) + still * 5e-3, 6)  # the encoder
    v = np.gradient(np.convolve(np.pad(x, 2, mode="edge"), np.ones(5) / 5, "valid"), t)
    stiffer = 1.0 + 0.5 * share(t, TISSUE_S, 10.0 * END_S)
    true_n = stiffer * (60.0 * x + 1.5 * v + 0.08 * np.tanh(v / 1e-3)) + 0.05
    burst = (t >= NANS_S) & (t % 7.0 < 0.05)
    f = np.where(burst, np.nan, true_n + 0.01 * rng.standard_normal(len(t)))
    predicted = replayed(Sample(t, np.where(burst & (t % 21.0 < 0.05), np.inf, x), f), DELAY_S)
    assert np.isfinite(predicted.force[t > 5.0]).all()
    assert np.abs(predicted.force[t > 5.0]).max() < 2.0 * np.nanmax(np.abs(f))
    before = (t > STILL_S - 5.0) & (t < STILL_S)
    again = (t > SINE_S + 1.0) & (t < SINE_S + 5.0)  # a second to find its weights
    error_n = np.abs(predicted.force - true_n)
    assert error_n[again].max() <= 1.5 * error_n[before].max()
    assert predicted.rms(true_n, t > NANS_S + 10.0) < 2.0 * predicted.rms(true_n, before)
