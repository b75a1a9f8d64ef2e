"""Test for a force that drives the motion, as a controller does and no contact.

The regression takes the motion as given. Where a controller turns what it measures into a force, the residual
acts back on the motion and the parameters lean (Soderstrom and Stoica, System Identification, 1989, chapter
10; Gautier and Poignet, Control Engineering Practice 9, 2001). The sign is power that the force gives to the
motion at several frequencies where both cohere. A smooth force on a well damped body shows none: it can not
be told from an imposed motion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.interpolate import Akima1DInterpolator
from scipy.signal import csd, welch

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.regression import ModelFit, RecordingRegression, alignment
from forefeel.diagnosis.signals import longest_piece

FLAG = "motion_driven_by_force"

_WINDOW_S = 4.0
_LEAST_SAMPLES = 600
_WINDOW = "blackmanharris"
_PER_OCTAVE = 8


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """Narrow bands of a stretch: frequency in Hz, coherence of x and f, f over x, sd of its phase in rad."""

    frequency_hz: Floats
    coherence: Floats
    transfer: NDArray[np.complex128]
    phase_sd: Floats


def feeds_the_motion(
    recording: Recording, force_n: Floats, regression: RecordingRegression, fit: ModelFit
) -> bool:
    """True if the force feeds power into the motion in three coherent bands or more: a controller drives it.

    A band counts only if it agrees for the force as measured and less the fit's part beside mass, damper and
    spring, each with a fitted delay, lag or fixture divided out and not: neither a late force nor a wrong
    name for one is a controller. False where the longest piece has fewer than 600 samples.

    Args:
        recording: position and stamps.
        force_n: cleaned, same stamps.
        regression, fit: of that recording.
    """
    piece = longest_piece(recording)
    if piece.stop - piece.start < _LEAST_SAMPLES:
        return False
    period_s, (x, f) = even(recording.time_s[piece], recording.position_m[piece], force_n[piece])
    linear_n = f - _bent_n(regression, fit, recording.time_s[piece][0] + period_s * np.arange(len(f)))
    every = bands(x, f, period_s)
    late = alignment(2.0 * np.pi * every.frequency_hz, fit.model)
    giving = np.ones(len(every.coherence), dtype=np.bool_)
    for b in (every, bands(x, linear_n, period_s)):
        for transfer in (b.transfer, b.transfer if late is None else b.transfer / late):
            taken = np.imag(transfer) / np.maximum(np.abs(transfer), 1e-300)
            giving &= (b.coherence > 0.9) & (taken + 4.0 * b.phase_sd < -0.03)
    return bool(np.count_nonzero(giving) >= 3)


def even(time_s: Floats, *columns: Floats) -> tuple[float, tuple[Floats, ...]]:
    """Resamples columns evenly at the median interval (Akima splines); returns (period in s, columns).
    Columns with stamps even to 5 % of the mean interval come back as they are, with that as the period.
    """
    period_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    grid = time_s[0] + period_s * np.arange(len(time_s))
    if np.max(np.abs(grid - time_s)) < 0.05 * period_s:
        return period_s, columns
    period_s = float(np.median(np.diff(time_s)))
    grid = np.arange(time_s[0], time_s[-1], period_s)
    return period_s, tuple(Akima1DInterpolator(time_s, column)(grid) for column in columns)


def bands(x: Floats, f: Floats, period_s: float) -> Bands:
    """Coherence and transfer from x to f, with the sd of its phase, by Welch, averaged over eighths of an
    octave from the fourth bin to 95 % of the Nyquist frequency.
    """
    rate, count = 1.0 / period_s, int(min(len(x) // 6, _WINDOW_S / period_s))
    frequency, cross = csd(x, f, rate, _WINDOW, nperseg=count, detrend="linear")
    motion, force = (welch(y, rate, _WINDOW, nperseg=count, detrend="linear")[1] for y in (x, f))
    octaves = np.log2(np.maximum(frequency, 1e-9) / frequency[3])
    number = np.floor(_PER_OCTAVE * octaves).astype(np.int64)
    rows = []
    for k in np.unique(number[(number >= 0) & (frequency < 0.95 * frequency[-1])]):
        at = number == k
        middle = np.mean(frequency[at])
        coherence = np.mean(np.abs(cross[at]) ** 2 / np.maximum(motion[at] * force[at], 1e-300))
        averages = 1.8 * len(x) / count * max(1.0, np.count_nonzero(at) / 3.0)
        sd = np.sqrt((1.0 - coherence) / (2.0 * max(coherence, 1e-9) * averages))
        turned = np.mean(cross[at] / frequency[at]) * middle
        rows.append((middle, coherence, turned / np.mean(motion[at] + 1e-300), sd))
    hz, coherences, transfer, deviations = np.array(rows, dtype=np.complex128).T
    return Bands(hz.real, coherences.real, transfer, deviations.real)


def _bent_n(regression: RecordingRegression, fit: ModelFit, time_s: Floats) -> Floats:
    """Force of the fit's causes, without mass, damper and spring, in N interpolated at these stamps; 0
    outside the pieces.
    """
    signals = regression.signals
    linear = regression.block(fit.model, "", ()) @ fit.of("")
    bent = regression.predicted(fit) - linear
    total = np.zeros(len(time_s))
    for grid, piece in zip(signals.pieces, signals.piecewise(fine=False), strict=True):
        fine = irfft(rfft(bent[piece]), grid.padded) * (grid.padded / grid.coarse)
        t = signals.origin_s + signals.t[piece.start] + grid.period_s * np.arange(grid.samples)
        inside = (time_s >= t[0] - 1e-9) & (time_s <= t[-1] + 1e-9)
        total[inside] = np.interp(time_s[inside], t, fine[: grid.samples])
    return total
