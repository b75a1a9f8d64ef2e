"""Whether what is left is noise: that of a measuring chain is forgotten within hundredths of a second."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression

HORIZON_S = 0.04
_TAPS = 12
_CORNER_HZ = 5.0
_LEAST_RATE_HZ = 150.0
_ORDER = 10
_MOST_SAMPLES = 600_000
_SPREAD_S = 0.5


def predictable_share(regression: RecordingRegression, fit: ModelFit) -> float:
    """Share of the residual's variance that its own past, at least 40 ms old, tells on the held-out half.

    First-order noise with a corner of 5 Hz or more leaves at most exp(-4 pi 5 0.04) = 8 %.
    """
    residual = regression.residual(fit)
    parts = [
        _pairs(residual[piece], regression.signals.rows[piece], regression)
        for piece in regression.signals.piecewise(fine=False)
    ]
    past, now = (np.concatenate(c) for c in zip(*parts, strict=True))
    if len(now) < 10 * _TAPS:
        return 0.0
    half = len(now) // 2
    shares = [_share(past[a], now[a], past[b], now[b]) for a, b in _halves(half, len(now))]
    return max(0.0, float(np.mean(shares)))


def noise_cap_n(recording: Recording, force_n: Floats) -> float | None:
    """The most that noise with a corner of 5 Hz or more can be, from what the force's own past does not tell.

    First-order noise of rms s and corner c has innovations of `s sqrt(1 - exp(-4 pi c / rate))` from sample
    to sample; motion is smooth at that rate and hardly adds. None where samples are too far apart to tell.
    """
    if recording.rate_hz < _LEAST_RATE_HZ:
        return None
    piece = max(recording.segments(), key=lambda s: s.stop - s.start)
    force = force_n[piece][:_MOST_SAMPLES]
    if len(force) < 50 * _ORDER:
        return None
    past = sliding_window_view(force, _ORDER + 1)[:: 1 + len(force) // 60_000]
    weights, *_ = np.linalg.lstsq(past[:, :-1], past[:, -1], rcond=None)
    innovation = past[:, -1] - past[:, :-1] @ weights
    size = 1.4826 * float(np.median(np.abs(innovation)))
    return size / float(np.sqrt(1.0 - np.exp(-4.0 * np.pi * _CORNER_HZ / recording.rate_hz)))


def _pairs(residual: Floats, rows: Floats, regression: RecordingRegression) -> tuple[Floats, Floats]:
    rate = regression.signals.coarse_rate_hz
    first = max(1, int(np.ceil(HORIZON_S * rate)))
    lags = np.unique(
        first + np.round(np.geomspace(1, max(2.0, _SPREAD_S * rate), _TAPS)).astype(np.int64) - 1
    )
    index = np.arange(int(lags[-1]), len(residual))
    if not len(index):
        return np.empty((0, len(lags))), np.empty(0)
    columns = residual[index[:, None] - lags]
    good = rows[index] & rows[index[:, None] - lags].all(axis=1)
    return columns[good], residual[index][good]


def _halves(half: int, count: int) -> list[tuple[slice, slice]]:
    return [(slice(0, half), slice(half, count)), (slice(half, count), slice(0, half))]


def _share(past: Floats, now: Floats, past_out: Floats, now_out: Floats) -> float:
    gram = past.T @ past
    gram[np.diag_indices_from(gram)] += 1e-3 * np.trace(gram) / len(gram) + 1e-300
    weights = np.linalg.solve(gram, past.T @ now)
    return 1.0 - float(np.sum((now_out - past_out @ weights) ** 2) / max(np.sum(now_out**2), 1e-300))
