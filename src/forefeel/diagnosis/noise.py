"""Two models of the noise: an autoregression of the residual, to whiten with; a floor of the force, from
where the motion has nothing, independent of any model of the contact.

Above the frequencies of the motion the force is noise, but for moments such as the jumps at reversals: only
short stretches without a reversal count, and of those the median. There the colour is learned,
`S(f) = white + coloured f^-slope`, and carried on to the frequencies of the motion. Carried so far it bounds
the noise: noise with a corner has less below it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.optimize import nnls
from scipy.signal import get_window, lfilter

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.signals import Mask, longest_piece, position_noise_m

_RIDGE = 1e-4
_ORDER = 12
LEAST_CORNER_HZ = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """`e(i) = sum_j taps(j) r(i - j)`, taps(0) = 1, is white with standard deviation `innovation_n`."""

    taps: Floats
    innovation_n: float

    def whiten(self, columns: Floats, pieces: Sequence[slice]) -> Floats:
        """Each column (axis 0 is time) through the whitening filter, started anew in every piece."""
        return np.concatenate([lfilter(self.taps, 1.0, columns[piece], axis=0) for piece in pieces])

    def response(self, phase: Floats) -> NDArray[np.complex128]:
        """Frequency response of the whitening, over innovation; `phase` in rad per sample, any shape."""
        lags = np.arange(len(self.taps))
        return np.asarray(np.exp(-1j * phase[..., None] * lags) @ self.taps / self.innovation_n)

    def rows(self, rows: Mask, pieces: Sequence[slice]) -> Mask:
        """Mask of the rows whose whitened value rests on counting rows only."""
        return _whole(rows, pieces, len(self.taps))


def white() -> Noise:
    return Noise(np.array([1.0, 0.0]), 1.0)


def autoregression(
    residual: Floats, rows: Mask, pieces: Sequence[slice], rate_hz: float, corner_hz: float = LEAST_CORNER_HZ
) -> Noise:
    """Autoregressive noise by a Yule-Walker fit to the rows that count, others taken as zero (Parzen's
    amplitude-modulated series); white noise where they are too few, or have no power. Autocovariance beyond
    that of noise with the corner `corner_hz` is clipped.
    """
    counted = float(np.count_nonzero(rows))
    order = _order(rows, pieces)
    mean = float(np.mean(residual[rows]))
    gamma = np.zeros(order + 1)
    pairs = np.zeros(order + 1)
    for piece in pieces:
        r, w = np.where(rows[piece], residual[piece] - mean, 0.0), rows[piece].astype(np.float64)
        for lag in range(min(order + 1, len(r))):
            gamma[lag] += r[lag:] @ r[: len(r) - lag]
            pairs[lag] += w[lag:] @ w[: len(w) - lag]
    gamma /= np.maximum(pairs, 1.0)
    longest = np.exp(-2.0 * np.pi * corner_hz / rate_hz * np.arange(order + 1))
    # what lasts longer is structure, which taken for noise would blind the search for slow causes
    gamma = np.clip(gamma, -gamma[0] * longest, gamma[0] * longest)
    gamma *= 1.0 - np.arange(order + 1) / max(counted, order + 2.0)
    if gamma[0] <= 0.0 or order < 2:
        return white()
    gamma[0] *= 1.0 + _RIDGE  # or the filter's stop-band would be blown up
    phi = solve_toeplitz(gamma[:-1], gamma[1:])
    variance = gamma[0] - float(phi @ gamma[1:])
    if variance <= 0.0:  # clipping left no autocovariance: first order, then
        phi, variance = gamma[1:2] / gamma[0], gamma[0] - gamma[1] ** 2 / gamma[0]
    return Noise(np.concatenate([[1.0], -phi]), float(np.sqrt(max(variance, 1e-300))))


def _order(rows: Mask, pieces: Sequence[slice]) -> int:
    """Order, up to 12, that leaves half of the rows: whitening costs so many behind each unusable one."""
    counted = int(np.count_nonzero(rows))
    order = min(_ORDER, counted // 20)
    while order > 1 and 2 * np.count_nonzero(_whole(rows, pieces, order + 1)) < counted:
        order //= 2
    return order


def _whole(rows: Mask, pieces: Sequence[slice], reach: int) -> Mask:
    """Mask of the rows that are the last of `reach` counting ones in a row of one piece."""
    good: list[Mask] = []
    for piece in pieces:
        count = np.concatenate([np.zeros(reach), np.cumsum(rows[piece])])
        good.append(np.asarray(count[reach:] - count[:-reach] == reach))
    return np.concatenate(good)


# s of a stretch whose spectrum is taken, the longest of which there are enough between two reversals
_STRETCHES_S = 0.5, 0.25, 0.125
_LEAST_STRETCHES, _LEAST_SAMPLES = 8, 16
_MOTION_STRETCH_S = 4.0  # s of those of the motion
# of white, pink and first-order noise above its corner; of what a filter left
_SLOPES = 0.0, 1.0, 2.0, 4.0, 6.0
_FLAT_BELOW_HZ = 1.0  # of first-order noise of a measuring chain
_STEEPEST = 2.0  # of noise; what falls faster has been filtered, and tells nothing of lower frequencies
_MOTION_SHARE = 0.999  # of the speed's power, below the frequency where the motion ends
_HIGHEST_START_HZ = 40.0  # beyond it nothing is said of the frequencies of hands
_LEAST_REACH = 3.0  # from the motion's end to the spectrum's: over less a colour is not told from another
_LEAST_BINS = 5  # of the spectrum above the motion: fewer tell no colour
_OF_MOTION = 10.0  # times the power of the encoder's noise, which is not quite white: more is motion
_ROUND_OFF = 1e-10  # of the largest power: less is none
_HIGHEST = 0.8  # of the Nyquist frequency: above it recorders filter
_ROUNDS = 3  # of weighting by the density of the last one
_OF_ONE = 2.1  # variance of the logarithm of the median of many periodograms, times their number
_LAW = 0.1  # by which real noise leaves such a law, in its logarithm
_BETTER = 9.0  # by how much -2 log likelihood must fall for a steeper colour, which promises more noise
_SMOOTHED_BINS = 24  # into which the spectrum above the motion is averaged, evenly in the logarithm
_TREND = 3  # of the polynomial that takes the motion's own share from a stretch
_LEAK = 2.0  # bins over which a stretch's window spreads a line
_FIRST_BIN = 3.0  # of a stretch's spectrum: below, the polynomial and the window reach
_SMOOTHING = 12  # of a stretch, over which the position is averaged before its reversals are looked for
_DENSE = 0.5  # of the samples: fewer levels are the steps of an encoder
_TURNED = 6.0  # standard deviations of what is left of its noise: a way back of less is no reversal
_OF_MEDIAN = float(np.log(2.0))  # median over mean of a periodogram's power (chi squared, two degrees)


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """`S(f) = white + coloured f^-slope` in N^2/Hz, one-sided."""

    white: float
    coloured: float
    slope: float

    def density(self, frequency_hz: Floats) -> Floats:
        """S in N^2/Hz; first-order noise is flat below 1 Hz: what rises further is no noise, but wanders."""
        from_hz = _FLAT_BELOW_HZ if self.slope > 1.0 else 0.0
        return np.asarray(self.white + self.coloured * np.maximum(frequency_hz, from_hz) ** -self.slope)

    def rms_n(self, low_hz: float, high_hz: float) -> float:
        grid = np.geomspace(low_hz, high_hz, 400)
        return float(np.sqrt(np.trapezoid(self.density(grid), grid)))


def noise_floor(recording: Recording, force_n: Floats, unusable: Mask | None = None) -> NoiseFloor | None:
    """Fits a noise floor to the spectrum of the force above the frequencies of the motion, in stretches of
    the longest piece without a reversal. None where the recording is too short or too slow to show it, or a
    filter made it fall steeply.

    `unusable`: samples whose force means nothing, such as the end of the cell's range, which has no noise.
    """
    piece = longest_piece(recording)
    time_s, rate_hz = recording.time_s[piece], recording.rate_hz
    even_s = np.arange(time_s[0], time_s[-1], 1.0 / rate_hz)
    force, position = (np.interp(even_s, time_s, y[piece]) for y in (force_n, recording.position_m))
    if unusable is not None and unusable.any():
        force[np.interp(even_s, time_s, unusable[piece].astype(np.float64)) > 0.0] = np.nan
    step_m = _encoder_step_m(recording.position_m[piece])
    motion_hz = _motion_ends_hz(position, step_m, rate_hz)
    for stretch_s in _STRETCHES_S:
        floor = _floor_above(force, position, step_m, rate_hz, stretch_s, motion_hz)
        if floor is not None:
            return None if floor.slope > _STEEPEST else floor
    return None


def _floor_above(
    force: Floats, position: Floats, step_m: float, rate_hz: float, stretch_s: float, motion_hz: float
) -> NoiseFloor | None:
    """Noise floor fitted to the median spectrum, above `motion_hz`, of stretches of `stretch_s` without a
    reversal. None: fewer than 8 stretches, too little spectrum above, or a force that stands still in most of
    them. NaN in `force` rules a stretch out.
    """
    count = int(stretch_s * rate_hz)
    if count < _LEAST_SAMPLES:
        return None
    starts = _one_way(position, step_m, rate_hz, count)
    starts = [start for start in starts if np.isfinite(force[start : start + count]).all()]
    from_hz = max(motion_hz + _LEAK / stretch_s, _FIRST_BIN / stretch_s)
    frequency = np.asarray(np.fft.rfftfreq(count, 1.0 / rate_hz), dtype=np.float64)
    above = (frequency >= from_hz) & (frequency < _HIGHEST * 0.5 * rate_hz)
    too_few = len(starts) < _LEAST_STRETCHES or np.count_nonzero(above) < _LEAST_BINS
    too_slow = _HIGHEST * 0.5 * rate_hz < _LEAST_REACH * from_hz
    if too_few or too_slow or from_hz > _HIGHEST_START_HZ:
        return None
    power = _spectra(np.stack([force[start : start + count] for start in starts]), _TREND)
    density = np.asarray(np.median(power, axis=0) / _OF_MEDIAN / rate_hz, dtype=np.float64)[above]
    return _fit_floor(frequency[above], density, len(starts)) if density.all() else None


def _one_way(position: Floats, step_m: float, rate_hz: float, count: int) -> list[int]:
    """Starts (indices) of stretches of `count` samples, overlapping by half, in which the position does not
    turn by more than the encoder's step or noise.
    """
    width = max(1, count // _SMOOTHING)
    smooth = uniform_filter1d(position, width, mode="nearest")
    least_m = max(_TURNED * position_noise_m(position, rate_hz) / float(np.sqrt(width)), step_m)
    least_m += _ROUND_OFF * float(np.ptp(position))
    starts = []
    for start in range(0, len(position) - count + 1, max(1, count // 2)):
        x = smooth[start : start + count]
        back = min(float(np.max(np.maximum.accumulate(x) - x)), float(np.max(x - np.minimum.accumulate(x))))
        if back <= least_m:
            starts.append(start)
    return starts


def _encoder_step_m(position: Floats) -> float:
    """The step of a position that takes few values; else 0."""
    levels = np.unique(position)
    return float(np.median(np.diff(levels))) if 1 < len(levels) < _DENSE * len(position) else 0.0


def _spectra(stretches: Floats, order: int) -> Floats:
    """Power of each stretch less a polynomial of that order, shape (stretches, frequencies)."""
    count = stretches.shape[1]
    window = get_window("hann", count)
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), order + 1))
    level = stretches - (stretches @ basis) @ basis.T
    return np.asarray(2.0 * np.abs(np.fft.rfft(level * window)) ** 2 / (window @ window))


def _motion_ends_hz(position: Floats, step_m: float, rate_hz: float) -> float:
    """Frequency below which 99.9 % of the speed's power lies, the noise of the encoder aside."""
    count = int(min(_MOTION_STRETCH_S * rate_hz, len(position)))
    starts = range(0, len(position) - count + 1, max(1, count // 2))
    power = _spectra(np.stack([position[start : start + count] for start in starts]), 1).mean(axis=0)
    frequency = np.fft.rfftfreq(count, 1.0 / rate_hz)
    floor = max(float(np.median(power[int(0.7 * len(power)) :])), 2.0 * step_m**2 / 12.0)
    least = max(_OF_MOTION * floor, _ROUND_OFF * float(power.max()))
    moved = np.where(power > least, power, 0.0) * frequency**2
    total = np.cumsum(moved)
    return float(frequency[int(np.searchsorted(total, _MOTION_SHARE * total[-1]))])


def _fit_floor(frequency: Floats, density: Floats, stretches: int) -> NoiseFloor:
    """Fits white + coloured f^-slope to a density in N^2/Hz, which it averages over bins first; a steeper
    slope (0 to 6) only where it clearly betters the likelihood. `stretches`: number of spectra behind it.
    """
    edges = np.geomspace(frequency[0], frequency[-1] * 1.0001, _SMOOTHED_BINS + 1)
    place = np.digitize(frequency, edges) - 1
    used, counts = np.unique(place, return_counts=True)
    f = np.array([np.exp(np.mean(np.log(frequency[place == k]))) for k in used])
    s = np.array([np.mean(density[place == k]) for k in used])
    doubt = np.sqrt(_OF_ONE / (0.5 * stretches * counts) + _LAW**2)
    best, least = NoiseFloor(float(np.median(s)), 0.0, 0.0), np.inf
    for slope in _SLOPES:
        columns = np.column_stack([np.ones_like(f), f**-slope])
        predicted = s
        for _ in range(_ROUNDS):
            (white, coloured), _ = nnls(columns / (predicted * doubt)[:, None], s / (predicted * doubt))
            predicted = np.maximum(columns @ (white, coloured), 1e-300)
        error = float(np.sum((np.log(s / predicted) / doubt) ** 2))
        if error < least - _BETTER:
            best, least = NoiseFloor(float(white), float(coloured), slope), error
    return best
