"""Tests for noise in what is left: by its memory and by its size.

The noise of a measuring chain is forgotten within hundredths of a second.
"""

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.diagnosis.noise import NoiseFloor
from forefeel.diagnosis.regression import RecordingRegression

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
