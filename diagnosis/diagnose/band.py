"""How much bandwidth the regression needs, and at what speed the direction is only noise."""

import numpy as np
from scipy.signal import csd, welch

from common.error_size import Floats
from common.recording.recording import Recording

_LEAST_HZ = 30.0
_MOST = 0.45  # of the sampling rate
_SHARE = 0.99
_BEYOND = 1.1


def cutoff_hz(recording: Recording, force_n: Floats) -> float:
    """1.1 times the frequency below which lies 99 % of the force's power that goes with the motion; at least
    30 Hz.
    """
    rate = recording.rate_hz
    most, least = _MOST * rate, min(_LEAST_HZ, _MOST * rate)
    x, f = _longest(recording, recording.position_m), _longest(recording, force_n)
    count = int(min(max(256, 2.0 * rate), len(x) // 4))
    if count < 32:
        return least
    v = np.gradient(x) * rate
    frequency, cross = csd(v, f, rate, nperseg=count)
    motion, force = welch(v, rate, nperseg=count)[1], welch(f, rate, nperseg=count)[1]
    coherent = np.abs(cross) ** 2 / np.maximum(motion * force, 1e-300)
    averages = max(1.0, 1.8 * len(x) / count)
    power = force * np.where(coherent > 3.0 / averages, coherent, 0.0)
    total = np.cumsum(power)
    reach = float(frequency[int(np.searchsorted(total, _SHARE * total[-1]))]) if total[-1] > 0.0 else 0.0
    return float(np.clip(_BEYOND * reach, least, most))


def speed_band_m_s(recording: Recording, cutoff: float) -> float:
    """Twice the standard deviation of the filtered speed at rest, from the noise of the position."""
    x = _longest(recording, recording.position_m)
    rate = recording.rate_hz
    third = np.diff(x, 3)
    size = np.abs(third)
    noise = float(np.sqrt(np.mean(size[size <= np.quantile(size, 0.9)] ** 2))) / np.sqrt(20.0) / 0.79
    band = min(2.0 * cutoff, 0.5 * rate)
    speed = noise * np.sqrt(2.0 / rate) * 2.0 * np.pi * band**1.5 / np.sqrt(3.0)
    usual = float(np.quantile(np.abs(np.diff(x)) * rate, 0.95))
    return float(max(2.0 * speed, 1e-3 * usual, 1e-12))


def _longest(recording: Recording, values: Floats) -> Floats:
    piece = max(recording.segments(max(0.1, 3.5 / recording.rate_hz)), key=lambda s: s.stop - s.start)
    return np.asarray(values[piece])
