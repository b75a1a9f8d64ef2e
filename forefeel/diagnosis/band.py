"""How much bandwidth the regression needs, and at what speed the direction is only noise."""

import numpy as np
from scipy.signal import csd, welch

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording

_LEAST_HZ = 30.0
_MOST = 0.45  # of the sampling rate
_SHARE = 0.9
_BEYOND = 1.2
MOST_ROWS = 9_000
"""Of the regression, at twice the cutoff: some 5 s of processor time."""
_SLOW_MOTION, _SLOW_FORCE = 0.95, 0.99  # of the power of speed and force below half of a lower cutoff


def cutoff_hz(recording: Recording, force_n: Floats) -> float:
    """1.2 times the frequency below which lies 90 % of the force's power that goes with the motion; at
    least 30 Hz, or what makes `MOST_ROWS` of a long recording that is slower than half of that.
    """
    rate = recording.rate_hz
    most, least = _MOST * rate, min(_LEAST_HZ, _MOST * rate)
    piece = longest_piece(recording)
    x, f = recording.position_m[piece], force_n[piece]
    count = int(min(max(256, 2.0 * rate), len(x) // 4))
    if count < 32:
        return least
    v = np.gradient(x) * rate
    frequency, cross = csd(v, f, rate, nperseg=count)
    motion, force = welch(v, rate, nperseg=count)[1], welch(f, rate, nperseg=count)[1]
    whole_hz = MOST_ROWS / (2.0 * recording.duration_s)
    slow = frequency <= 0.5 * whole_hz
    if whole_hz < least and all(
        np.sum(power[slow]) > share * np.sum(power)
        for power, share in ((motion, _SLOW_MOTION), (force, _SLOW_FORCE))
    ):
        return whole_hz
    coherent = np.abs(cross) ** 2 / np.maximum(motion * force, 1e-300)
    averages = max(1.0, 1.8 * len(x) / count)
    power = force * np.where(coherent > 3.0 / averages, coherent, 0.0)
    total = np.cumsum(power)
    reach = float(frequency[int(np.searchsorted(total, _SHARE * total[-1]))]) if total[-1] > 0.0 else 0.0
    return float(np.clip(_BEYOND * reach, least, most))


def speed_band_m_s(position_m: Floats, rate_hz: float, reach_hz: float) -> float:
    """1.5 times the standard deviation of the speed at rest, in the band up to `reach_hz`, of evenly sampled
    positions.
    """
    band = min(reach_hz, 0.5 * rate_hz)
    noise = position_noise_m(position_m, rate_hz)
    speed = noise * float(np.sqrt(2.0 / rate_hz)) * 2.0 * np.pi * band**1.5 / float(np.sqrt(3.0))
    usual = float(np.quantile(np.abs(np.diff(position_m)) * rate_hz, 0.95))
    return float(max(1.5 * speed, 2e-4 * usual, 1e-12))


def gapless(recording: Recording) -> list[slice]:
    """Stretches in which at most three samples in a row are missing."""
    return recording.segments(max(0.1, 3.5 / recording.rate_hz))


def longest_piece(recording: Recording) -> slice:
    """The longest stretch without a gap."""
    return max(gapless(recording), key=lambda s: s.stop - s.start)


def position_noise_m(position_m: Floats, rate_hz: float) -> float:
    """Standard deviation of the position's noise, the smaller of two estimates, for motion enters both.

    From third differences, the largest tenth left out; from the level at the end of the spectrum.
    """
    size = np.abs(np.diff(position_m, 3))
    kept = size[size <= np.quantile(size, 0.9)]
    by_difference = float(np.sqrt(np.mean(kept**2))) / float(np.sqrt(20.0)) / 0.79
    count = int(min(len(position_m), max(128, 3.0 * rate_hz)))
    power = welch(position_m, rate_hz, "blackmanharris", nperseg=count, detrend="linear")[1]
    by_level = float(np.sqrt(np.median(power[int(0.8 * len(power)) :]) * rate_hz / 2.0))
    return min(by_difference, by_level)
