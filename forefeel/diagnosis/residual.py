"""Tests for noise in what is left: by its memory, by its size, by a model of it without physics.

The noise of a measuring chain is forgotten within hundredths of a second. The model is what any function of
the motion, its past and time could still explain: bumps over position, speed and acceleration, over pairs of
them, over the distance since the last reversal, over time, and lagged motion; ridge regression, scored on
held-out blocks. Where it gains clearly, something is there that no named cause explains.
"""

import numpy as np

from forefeel.common.causes.motion import Lag, MotionGrid
from forefeel.common.causes.periodic import Pulsation
from forefeel.common.error_size import Floats
from forefeel.diagnosis.noise import NoiseFloor
from forefeel.diagnosis.regression import ModelFit, RecordingRegression, alignment
from forefeel.diagnosis.uncertainty import columns, gain, held_out
from forefeel.diagnosis.verdict import HeldOut

HORIZON_S = 0.04
_TAPS = 12
_SPREAD_S = 0.5
_MOST_NOISE = 4.0  # times the power that the floor says: it is known to a factor of two in rms


def predictable_share(regression: RecordingRegression, values: Floats, horizon_s: float = HORIZON_S) -> float:
    """Share, 0 to 1, of the variance of values on the coarse grid that a regression on their own past, at
    least `horizon_s` old, predicts, each half by the other; 0 where too few samples have such a past.

    Of first-order noise with a corner of 5 Hz or more 40 ms leave at most exp(-4 pi 5 0.04) = 8 %.
    """
    values = values - float(np.mean(values[regression.signals.rows]))
    parts = [
        _pairs(values[piece], regression.signals.rows[piece], regression, horizon_s)
        for piece in regression.signals.piecewise(fine=False)
    ]
    past, now = (np.concatenate(c) for c in zip(*parts, strict=True))
    if len(now) < 10 * _TAPS:
        return 0.0
    halves = slice(0, len(now) // 2), slice(len(now) // 2, None)
    shares = [_share(past[a], now[a], past[b], now[b]) for a, b in (halves, halves[::-1])]
    return max(0.0, float(np.mean(shares)))


def excess_share(regression: RecordingRegression, residual: Floats, floor: NoiseFloor) -> float:
    """Share, 0 to 1, of the residual's power that exceeds four times the noise floor, octave by octave, in
    the piece with the most rows that count.
    """
    pieces = regression.signals.piecewise(fine=False)
    piece = max(pieces, key=lambda p: int(np.count_nonzero(regression.signals.rows[p])))
    values = residual[piece][regression.signals.rows[piece]]
    rate_hz = regression.signals.coarse_rate_hz
    frequency = np.asarray(np.fft.rfftfreq(len(values), 1.0 / rate_hz)[1:], dtype=np.float64)
    power = 2.0 * np.abs(np.fft.rfft(values - values.mean())[1:]) ** 2 / (rate_hz * len(values))
    octave = np.floor(np.log2(frequency / frequency[0])).astype(np.int64)
    expected = floor.density(frequency)
    more = sum(
        max(0.0, float(np.sum(power[octave == k]) - _MOST_NOISE * np.sum(expected[octave == k])))
        for k in range(int(octave[-1]) + 1)
    )
    return more / max(float(np.sum(power)), 1e-300)


def _pairs(
    residual: Floats, rows: Floats, regression: RecordingRegression, horizon_s: float
) -> tuple[Floats, Floats]:
    """(past, now) of a piece: values at up to 12 lags, from the horizon to 0.5 s more, a row for each sample,
    and the samples themselves; only where all of these count. Empty for a piece shorter than the lags.
    """
    rate = regression.signals.coarse_rate_hz
    first = max(1, int(np.ceil(horizon_s * rate)))
    spread = np.round(np.geomspace(1, max(2.0, _SPREAD_S * rate), _TAPS)).astype(np.int64)
    lags = np.unique(first + spread - 1)
    index = np.arange(int(lags[-1]), len(residual))
    if not len(index):
        return np.empty((0, len(lags))), np.empty(0)
    columns = residual[index[:, None] - lags]
    good = rows[index] & rows[index[:, None] - lags].all(axis=1)
    return columns[good], residual[index][good]


def _share(past: Floats, now: Floats, past_out: Floats, now_out: Floats) -> float:
    gram = past.T @ past
    gram[np.diag_indices_from(gram)] += 1e-3 * np.trace(gram) / len(gram) + 1e-300
    weights = np.linalg.solve(gram, past.T @ now)
    return 1.0 - float(np.sum((now_out - past_out @ weights) ** 2) / max(np.sum(now_out**2), 1e-300))


_RIDGES = 1e-4, 1e-2
_LAGS_S = 0.03, 0.1, 0.3, 1.0


def flexible_gain(regression: RecordingRegression, fit: ModelFit) -> HeldOut:
    """Held-out gain of the named causes and bumps over the named causes alone; the best ridge of two."""
    return _gain_of(regression, fit, _features(regression, fit), _RIDGES)


def _gain_of(
    regression: RecordingRegression, fit: ModelFit, extra: Floats, ridges: tuple[float, ...]
) -> HeldOut:
    """Held-out gain of the fit's columns with `extra` ones (coarse grid, not whitened) over the fit's columns
    alone; that of the ridge on the extra ones, of `ridges`, that gains most.
    """
    white, plain = columns(regression, fit)
    alone, pieces = held_out(regression, white, plain), regression.signals.piecewise(fine=False)
    extra_white = regression.noise.whiten(extra, pieces)[regression.rows] / regression.noise.innovation_n
    both = np.hstack([white, extra_white]), np.hstack([plain, extra[regression.rows]])
    trials = []
    for ridge in ridges:
        weights = np.repeat([1e-10, ridge], [white.shape[1], extra.shape[1]])
        trials.append(gain(regression, alone, held_out(regression, *both, ridge=weights)))
    return max(trials, key=lambda trial: trial.gain)


def modulation_gain(regression: RecordingRegression, fit: ModelFit) -> HeldOut | None:
    """Held-out gain of a stiffness that pulses at the fitted frequency; None without a pulsation.

    The vocabulary's pulsation is a force of its own: one that grows with the depth is something else.
    """
    if Pulsation.name not in fit.model:
        return None
    t, (frequency_hz,) = regression.signals.t, fit.model[Pulsation.name]
    depth = regression.block(fit.model, "", ())[:, 2]
    phase = 2.0 * np.pi * frequency_hz * t
    extra = np.column_stack([depth * np.sin(phase), depth * np.cos(phase)])
    return _gain_of(regression, fit, extra, (1e-10,))


def _features(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Columns without physics, shape (coarse samples, columns): those of `_moving`, filtered and delayed as
    the cell shows them, and 6 to 30 bumps over time.
    """
    signals, factor = regression.signals, alignment(regression.signals.omega, fit.model)
    spectra = map(signals.spectrum, _moving(regression.motion(fit.model)))
    late = [signals.column(s if factor is None else s * factor) for s in spectra]
    knots = int(np.clip(regression.extent.duration_s / 2.0, 6, 30))
    over_time = _bumps(signals.t, np.linspace(signals.t[0], signals.t[-1], knots))
    return np.column_stack([*late, *over_time])


def _moving(motion: MotionGrid) -> list[Floats]:
    """Columns of the motion and its past, on the fine grid: bumps over position, speed, acceleration, pairs
    of them and the distance since a reversal, and lagged speeds.
    """
    x, v, a = motion.x, motion.v, motion.a
    s = motion.direction()
    table = _bumps(x, _knots(x, 10)) + _bumps(v, _knots(v, 10)) + _bumps(a, _knots(a, 8))
    table += [b * s for b in _bumps(x, _knots(x, 6))]
    wide_x, wide_v, wide_a = _bumps(x, _knots(x, 5)), _bumps(v, _knots(v, 5)), _bumps(a, _knots(a, 4))
    table += [p * q for p in wide_x for q in wide_v]
    table += [p * q for p in wide_v for q in wide_a]
    table += [b * x for b in wide_x] + [b * v for b in wide_x]
    since = since_reversal(motion)
    table += [b * s for b in _bumps(since, _knots(since, 6))]
    for lag_s in _LAGS_S:
        table += [_smoothed(motion, values, lag_s) for values in (v, np.abs(v), v * np.abs(v))]
    return table


def _knots(values: Floats, count: int) -> Floats:
    """Half by quantiles, half evenly: where the data are and over the whole range."""
    low, high = np.quantile(values, (0.01, 0.99))
    even = np.linspace(low, high, count)
    return 0.5 * (even + np.quantile(values, np.linspace(0.01, 0.99, count)))


def _bumps(values: Floats, knots: Floats) -> list[Floats]:
    """Triangles that sum to one."""
    return [np.interp(values, knots, row) for row in np.eye(len(knots))]


def since_reversal(motion: MotionGrid) -> Floats:
    """Distance from the position where the direction last changed, or the piece began, in m at each fine
    sample; speeds within the band keep the direction.
    """
    away = np.empty_like(motion.x)
    for piece in motion.pieces:
        x = motion.x[piece]
        s = np.sign(np.where(np.abs(motion.v[piece]) > motion.speed_band, motion.v[piece], 0.0))
        held = s[np.maximum.accumulate(np.where(s != 0.0, np.arange(len(s)), 0))]
        turned = np.concatenate([[True], np.diff(held) != 0.0])
        origin = np.maximum.accumulate(np.where(turned, np.arange(len(s)), 0))
        away[piece] = np.abs(x - x[origin])
    return away


def _smoothed(motion: MotionGrid, values: Floats, tau_s: float) -> Floats:
    return motion.through(Lag().step, values, np.exp(-motion.dt / tau_s))
