"""Motion and force through one and the same low-pass, on a grid that is just fine enough for it.

Every column of the model and the force pass the same zero-phase filter H, so that the regression `H f = sum
theta_i H phi_i` is that of the unfiltered signals and theta is not biased by it (matched filtering, Gautier
and Poignet, Control Engineering Practice 9, 2001). Derivatives are taken in the spectrum: `(j w)^d H X`. Two
grids: the fine one carries the motion that nonlinear columns are computed from, the coarse one, with its
Nyquist frequency at the end of the pass-band, the regression.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import csd, welch

from forefeel.common.causes.candidate import ColumnExtent, Extent, Spectrum
from forefeel.common.error_size import Floats
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Column, Recording

Mask = NDArray[np.bool_]

_FINE_PER_BAND = 16.0
_TAPER = 0.75  # the pass-band is flat up to this share of the cutoff
_EDGE = 4.0  # in periods of the cutoff: what the filter's response reaches
_ENDS = (0.6, 0.8, 0.97), (0.3, 0.42, 0.6)  # of the Nyquist frequency; uneven stamps damp the upper end
_EDGE_S, _PAD_S = 0.5, 1.5
_FALL = 0.3  # of the motion's reach, in which its spectrum is brought to zero
_LEAST_SEGMENT = 3.0  # in edges


@dataclass(frozen=True, slots=True, eq=False)
class SignalPiece:
    """One gapless stretch: lengths of its grids, raw, fine and coarse, padding included; `edge_s`: at each
    end, where rows do not count.
    """

    start_s: float
    period_s: float
    samples: int
    padded: int
    fine: int
    coarse: int
    edge_s: float

    @property
    def span_s(self) -> float:
        """Length in s, padding included."""
        return self.padded * self.period_s


class Signals:
    """A recording, conditioned.

    Args:
        recording: with force.
        force_n: the force to use, cleaned of spikes and lines; same stamps.
        cutoff_hz: end of the pass-band.
        unusable: samples whose force means nothing (clipped).

    Attributes:
        fine_t, fine_x, fine_v, fine_a: time in s since the start and motion on the fine grid, padding
        included.
        t, force: on the coarse grid, filtered.
        rows: the coarse samples that count, shape as `t`.
        starts: first coarse index of each piece.
        even_m, even_hz: the longest piece of the position, evenly sampled, and its rate.
        motion_reach_hz: up to where the position is more than its noise.
        step_m: of the encoder.
    """

    def __init__(self, recording: Recording, force_n: Floats, cutoff_hz: float, unusable: Mask) -> None:
        self.cutoff_hz = cutoff_hz
        self.origin_s = float(recording.time_s[0])
        self.pieces: list[SignalPiece] = []
        self._gains: dict[SignalPiece, Floats] = {}
        self.motion_reach_hz, self.even_hz, self.step_m = 0.0, 1.0, 0.0
        self.even_m: Floats = np.empty(0)
        self._raw: list[tuple[Spectrum, Spectrum]] = []
        self.units = {column.name: column.unit for column in recording.further}
        beside: list[list[Floats]] = []
        motion: list[tuple[Floats, ...]] = []
        coarse: list[tuple[Floats, Floats, Mask]] = []
        for piece in gapless(recording):
            time_s = recording.time_s[piece] - self.origin_s
            grid = _grid(time_s, cutoff_hz)
            if grid is None:
                continue
            x, f, bad = _uniform(time_s, grid, recording.position_m[piece], force_n[piece], unusable[piece])
            x_spec, f_spec = rfft(_padded(x, grid.padded)), rfft(_padded(f, grid.padded))
            step_m = _step_m(recording.position_m[piece])
            if len(x) > len(self.even_m):
                self.even_m, self.even_hz, self.step_m = x, 1.0 / grid.period_s, step_m
            gain = _above_noise(x, x_spec, step_m, grid)
            x_spec *= gain
            self.motion_reach_hz = max(self.motion_reach_hz, float(np.sum(gain)) / grid.span_s)
            self.pieces.append(grid)
            self._gains[grid] = response(np.arange(grid.coarse // 2 + 1) / grid.span_s, cutoff_hz)
            self._raw.append((x_spec, f_spec))
            motion.append(self._motion(grid, x_spec))
            beside.append([self._further(grid, time_s, piece, column) for column in recording.further])
            coarse.append(self._coarse(grid, f_spec, bad | _unsettled(x)))
        if not self.pieces:
            raise RecordingError(f"{recording.source}: no stretch without gaps is long enough")
        self.fine_t, self.fine_x, self.fine_v, self.fine_a = (
            np.concatenate(c) for c in zip(*motion, strict=True)
        )
        columns = map(np.concatenate, zip(*beside, strict=True))
        self.fine_further = dict(zip(self.units, columns, strict=True))
        self.t, self.force, self.rows = (np.concatenate(c) for c in zip(*coarse, strict=True))
        if not self.rows.any():
            raise RecordingError(f"{recording.source}: no sample of the force stands beside the motion")
        self.starts = np.cumsum([0, *(p.coarse for p in self.pieces)])
        self.fine_starts = np.cumsum([0, *(p.fine for p in self.pieces)])
        self._spec_starts = np.cumsum([0, *(p.coarse // 2 + 1 for p in self.pieces)])
        self.omega = np.concatenate(
            [2.0 * np.pi * np.arange(p.coarse // 2 + 1) / p.span_s for p in self.pieces]
        )

    @classmethod
    def of_motion(
        cls, time_s: Floats, position_m: Floats, cutoff_hz: float, further: tuple[Column, ...] = ()
    ) -> "Signals | None":
        """Conditions a motion, with a force of zeros; None where it is too short."""
        none_n, nowhere = np.zeros_like(time_s), np.zeros(len(time_s), dtype=np.bool_)
        try:
            motion = Recording("", time_s, position_m, none_n, "", further=further)
            return cls(motion, none_n, cutoff_hz, nowhere)
        except RecordingError:
            return None

    @property
    def decimated(self) -> bool:
        """True if the fine grid of any piece is coarser than the samples."""
        return any(p.span_s / p.fine > 1.3 * p.period_s for p in self.pieces)

    @property
    def recorded(self) -> Mask:
        """Mask of the fine grid's samples that are no padding."""
        parts = [np.arange(p.fine) * (p.span_s / p.fine) <= (p.samples - 1) * p.period_s for p in self.pieces]
        return np.concatenate(parts)

    @property
    def phase(self) -> Floats:
        """Phase of each frequency of a spectrum, in rad per coarse sample."""
        return np.concatenate([2.0 * np.pi * np.arange(p.coarse // 2 + 1) / p.coarse for p in self.pieces])

    def moved_to(self, origin_s: float) -> None:
        """Sets the stamp that times count from; to be called before a regression is made of these signals."""
        later = self.origin_s - origin_s
        self.fine_t, self.t, self.origin_s = self.fine_t + later, self.t + later, origin_s

    def linear_spectrum(self, derivative: int) -> Spectrum:
        """Filtered spectrum of the position's derivative, straight from the raw samples."""
        raw = zip(self.pieces, self._raw, strict=True)
        return np.concatenate([self._cut(grid, x, grid.padded, derivative) for grid, (x, _) in raw])

    def force_spectrum(self) -> Spectrum:
        raw = zip(self.pieces, self._raw, strict=True)
        return np.concatenate([self._cut(grid, f, grid.padded) for grid, (_, f) in raw])

    def spectrum(self, fine: Floats) -> Spectrum:
        """Filtered spectrum of columns that are given on the fine grid, shape (..., fine)."""
        parts = zip(self.pieces, self.piecewise(), strict=True)
        cut = [self._cut(grid, rfft(fine[..., piece]), grid.fine) for grid, piece in parts]
        return np.concatenate(cut, axis=-1)

    def column(self, spectrum: Spectrum) -> Floats:
        """Spectra back in time, on the coarse grid, shape (..., coarse)."""
        parts = [
            irfft(spectrum[..., self._spec_starts[i] : self._spec_starts[i + 1]], grid.coarse)
            for i, grid in enumerate(self.pieces)
        ]
        return np.concatenate(parts, axis=-1)

    def piecewise(self, fine: bool = True) -> Sequence[slice]:
        """Slices of the pieces on the fine or on the coarse grid."""
        starts = self.fine_starts if fine else self.starts
        return [slice(int(a), int(b)) for a, b in pairwise(starts)]

    @property
    def coarse_rate_hz(self) -> float:
        """Rate of the first piece; those of others differ by rounding."""
        return self.pieces[0].coarse / self.pieces[0].span_s

    def _cut(self, grid: SignalPiece, spectrum: Spectrum, length: int, derivative: int = 0) -> Spectrum:
        bins = grid.coarse // 2 + 1
        cut = spectrum[..., :bins] * (self._gains[grid] * (grid.coarse / length))
        if derivative:
            cut *= (2j * np.pi * np.arange(bins) / grid.span_s) ** derivative
        return np.asarray(cut)

    def _motion(self, grid: SignalPiece, x_spec: Spectrum) -> tuple[Floats, ...]:
        """Time, position, speed on the fine grid up to twice the cutoff; acceleration up to 1.2 times."""
        bins = min(grid.fine // 2 + 1, len(x_spec))
        frequency = np.asarray(np.arange(bins) / grid.span_s, dtype=np.float64)
        wide = response(frequency, 2.0 * self.cutoff_hz)
        narrow = response(frequency, 1.2 * self.cutoff_hz)
        scale = grid.fine / grid.padded
        full = np.zeros((3, grid.fine // 2 + 1), dtype=np.complex128)
        jw = 2j * np.pi * frequency
        full[0, :bins] = x_spec[:bins] * wide * scale
        full[1, :bins] = x_spec[:bins] * wide * jw * scale
        full[2, :bins] = x_spec[:bins] * narrow * jw**2 * scale
        t = np.asarray(grid.start_s + np.arange(grid.fine) * (grid.span_s / grid.fine), dtype=np.float64)
        x, v, a = (irfft(row, grid.fine) for row in full)
        return t, x, v, a

    def _further(self, grid: SignalPiece, time_s: Floats, piece: slice, column: Column) -> Floats:
        """A further column on the fine grid, in the band of the position; an angle without its wraps."""
        values = np.unwrap(column.values[piece]) if column.unit == "rad" else column.values[piece]
        even, _, _ = _uniform(time_s, grid, values, values, np.zeros(len(values), dtype=np.bool_))
        return self._motion(grid, rfft(_padded(even, grid.padded)))[1]

    def _coarse(self, grid: SignalPiece, f_spec: Spectrum, bad: Mask) -> tuple[Floats, Floats, Mask]:
        """Time in s and filtered force on the coarse grid, and the mask of rows that count: not at edges, nor
        within a period of the cutoff from raw samples that are `bad`.
        """
        t = np.asarray(np.arange(grid.coarse) * (grid.span_s / grid.coarse), dtype=np.float64)
        rows = (t >= grid.edge_s) & (t <= (grid.samples - 1) * grid.period_s - grid.edge_s)
        rows &= ~_near(bad, t, grid.period_s, 1.0 / self.cutoff_hz)
        return grid.start_s + t, irfft(self._cut(grid, f_spec, grid.padded), grid.coarse), rows


def response(frequency_hz: NDArray[np.floating[Any]], cutoff_hz: float) -> Floats:
    """Magnitude of the low-pass: one up to 0.75 cutoff, a raised cosine, zero from the cutoff on."""
    depth = np.clip((frequency_hz / cutoff_hz - _TAPER) / (1.0 - _TAPER), 0.0, 1.0)
    return np.asarray(0.5 * (1.0 + np.cos(np.pi * depth)))


def _grid(time_s: Floats, cutoff_hz: float) -> SignalPiece | None:
    """Lengths of a piece's raw, fine and coarse grids, padding included; None where it has fewer than 16
    samples or lasts less than 12 periods of the cutoff.
    """
    edge_s = _EDGE / cutoff_hz
    if len(time_s) < 16 or time_s[-1] - time_s[0] < _LEAST_SEGMENT * edge_s:
        return None
    period_s = float(np.median(np.diff(time_s)))
    samples = int((time_s[-1] - time_s[0]) / period_s + 1e-6) + 1
    pad_s = max(2.0 * edge_s, min(_PAD_S, 0.1 * samples * period_s))
    padded = _even_fast_length(samples + int(pad_s / period_s) + 2)
    span_s = padded * period_s
    coarse = min(_even_fast_length(int(2.0 * cutoff_hz * span_s) + 2), padded)
    fine = min(_even_fast_length(int(_FINE_PER_BAND * cutoff_hz * span_s)), max(padded, 2 * coarse))
    fine = max(fine, coarse)
    edge_s = min(max(edge_s, _EDGE_S), 0.1 * (samples - 1) * period_s)
    return SignalPiece(float(time_s[0]), period_s, samples, padded, fine, coarse, edge_s)


def _even_fast_length(least: int) -> int:
    return 2 * int(next_fast_len((least + 1) // 2, real=True))


def _uniform(
    time_s: Floats, grid: SignalPiece, x: Floats, f: Floats, bad: Mask
) -> tuple[Floats, Floats, Mask]:
    """Resamples position, force and mask onto the piece's even grid; returns them as they are where the
    stamps are even up to their rounding.
    """
    even = np.asarray(grid.start_s + np.arange(grid.samples) * grid.period_s, dtype=np.float64)
    if len(even) == len(time_s) and np.max(np.abs(even - time_s)) < 0.05 * grid.period_s:
        return x, f, bad
    nearest = np.clip(np.searchsorted(time_s, even), 0, len(time_s) - 1)
    return _interpolated(even, time_s, x), _interpolated(even, time_s, f), bad[nearest]


def _interpolated(at: Floats, time_s: Floats, values: Floats) -> Floats:
    from scipy.interpolate import Akima1DInterpolator  # noqa: PLC0415 - only uneven stamps need it

    return np.asarray(Akima1DInterpolator(time_s, values)(np.clip(at, time_s[0], time_s[-1])))


def _padded(values: Floats, length: int) -> Floats:
    """Prolongs values behind their end to `length`: both ends mirrored point-symmetrically, one fading into
    the other, so that neither value nor slope jumps where the last sample meets the first.
    """
    count = length - len(values)
    reach = min(count, len(values) - 1)
    after = 2.0 * values[-1] - values[-2 : -2 - reach : -1]
    before = 2.0 * values[0] - values[reach:0:-1]
    way = np.arange(1, count + 1) / (count + 1)
    fade = 0.5 * (1.0 + np.cos(np.pi * way))
    after = np.concatenate([after, np.full(count - reach, after[-1])])
    before = np.concatenate([np.full(count - reach, before[0]), before])
    return np.concatenate([values, fade * after + (1.0 - fade) * before])


def _step_m(x: Floats) -> float:
    """Step of the encoder; of a position without steps next to nothing, 0 of a constant one."""
    gaps = np.diff(np.unique(x))
    gaps = gaps[gaps > 1e-9 * np.ptp(x)]
    return float(np.quantile(gaps, 0.05)) if len(gaps) else 0.0


def _above_noise(x: Floats, x_spec: Spectrum, step_m: float, grid: SignalPiece) -> Floats:
    """Gain by frequency of `x_spec`: one up to where the position's spectrum sinks into the encoder's noise,
    falling to zero within 0.3 of that, so that no noise is derived; one everywhere where the spectrum still
    falls at its end.
    """
    frequency, power = _spectrum(x, 1.0 / grid.period_s)
    for low, middle, high in _ENDS:
        upper, top = _band(power, low, middle), _band(power, middle, high)
        if 0.0 < upper < 2.5 * top:
            break
    else:
        return np.ones(len(x_spec))
    # at a constant speed the encoder's steps are lines, which hold no more than step^2 / 12 in all
    above = median_filter(power, 7, mode="nearest") > 3.0 * top
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False))
    first, behind = edges[::2], edges[1::2]
    held_m2 = np.cumsum((power * above)[::-1])[::-1][first] * frequency[1]  # from there on
    motion = (held_m2 > step_m**2 / 12.0) | (np.arange(len(first)) == 0)
    last = int(np.max(behind[motion] - 1, initial=2))  # a line in time is nowhere above its noise
    # the windows of that spectrum fade at both ends, where a chirp is fastest: there the motion may go on
    power = np.maximum(power, _power_beyond(frequency[last], x_spec, grid, len(power)))
    beyond = median_filter(power, 7, mode="nearest")[last:] > 10.0 * top
    last += len(beyond) - 1 if beyond.all() else max(int(np.argmin(beyond)) - 1, 0)
    # a gradual (Wiener's) gain would shrink the motion, and with it bias the mass; a steeper one would ring
    depth = np.clip((np.arange(len(x_spec)) / grid.span_s / frequency[last] - 1.0) / _FALL, 0.0, 1.0)
    return np.asarray(0.5 * (1.0 + np.cos(np.pi * depth)))


def _power_beyond(from_hz: float, x_spec: Spectrum, grid: SignalPiece, bins: int) -> Floats:
    """Power density of the position above `from_hz`, over all of the piece and faded only at rows that do not
    count, at `bins` frequencies up to the Nyquist frequency, each the mean of what is around it.
    """
    # without slow motion nothing leaks
    fast = irfft(np.where(np.arange(len(x_spec)) > from_hz * grid.span_s, x_spec, 0.0), grid.padded)
    t = np.arange(grid.samples) * grid.period_s
    fade = np.sin(0.5 * np.pi * np.clip(np.minimum(t, t[::-1]) / grid.edge_s, 0.0, 1.0)) ** 2
    power = 2.0 * np.abs(rfft(fade * fast[: grid.samples])) ** 2 * grid.period_s / grid.samples
    width = len(power) // bins
    at = np.linspace(0, len(power) - 1, bins).astype(np.int64)
    return np.asarray(uniform_filter1d(power, max(width, 1))[at])


def _band(power: Floats, low: float, high: float) -> float:
    first, last = int(low * len(power)), int(high * len(power))
    return float(np.median(power[first : max(last, first + 1)]))


def _unsettled(x: Floats) -> Mask:
    """Mask of the start, up to a tenth, until half the stroke is covered: there friction is unknown."""
    stroke = float(np.quantile(x, 0.95) - np.quantile(x, 0.05))
    covered = np.maximum.accumulate(x) - np.minimum.accumulate(x)
    first = int(np.argmax(covered >= 0.5 * stroke))
    return np.asarray(np.arange(len(x)) < min(first, len(x) // 10))


def _near(bad: Mask, t: Floats, period_s: float, reach_s: float) -> Mask:
    """Mask of the coarse stamps with an unusable raw sample within reach."""
    if not bad.any():
        return np.zeros(len(t), dtype=np.bool_)
    count = np.concatenate([[0], np.cumsum(bad)])
    low = np.clip(((t - reach_s) / period_s).astype(np.int64), 0, len(bad))
    high = np.clip(((t + reach_s) / period_s).astype(np.int64) + 2, 0, len(bad))
    return np.asarray(count[high] > count[low])


def _travelled_m(x: Floats) -> Floats:
    """Quantiles of .005, .05, .95, .995 of the positions; over the way, not the time, where that says three
    times as much: an axis that hardly moves for most of the time has its strokes in the rest.
    """
    levels = (0.005, 0.05, 0.95, 0.995)
    by_time = np.quantile(x, levels)
    way = np.cumsum(np.abs(np.diff(x)))
    if not len(way) or not way[-1]:
        return by_time
    order = np.argsort(x[1:], kind="stable")
    share = np.cumsum(np.diff(way, prepend=0.0)[order]) / way[-1]
    by_way = x[1:][order][np.minimum(np.searchsorted(share, levels), len(order) - 1)]
    return by_way if by_way[2] - by_way[1] > 3.0 * (by_time[2] - by_time[1]) else by_time


def extent_of(signals: Signals, speed_band: float) -> Extent:
    """Extent of motion and force, without padding, over which causes are searched: bandwidth, length, ranges
    of position and force from 0.5 to 99.5 % of the values, stroke from 5 to 95 %, speed up to 95 %.
    """
    recorded = signals.recorded
    low, q1, q2, high = _travelled_m(signals.fine_x[recorded])
    low_n, high_n = np.quantile(signals.force[signals.rows], (0.005, 0.995))
    return Extent(
        signals.cutoff_hz,
        float(signals.t[-1] - signals.t[0]),
        float(q2 - q1),
        float(np.quantile(np.abs(signals.fine_v[recorded]), 0.95)),
        float(low),
        float(high),
        speed_band,
        float(low_n),
        float(high_n),
        tuple(
            ColumnExtent(name, signals.units[name], float(np.ptp(values[recorded])))
            for name, values in signals.fine_further.items()
        ),
    )


_OWN = 0.5  # share of a column that the motion explains, above which it is of the same axis
_AGAIN = 0.9  # correlation with the force above which it is the same force again


def without_dependent_columns(recording: Recording) -> Recording:
    """Copies the recording without further columns that a fit of position and speed explains nearly all of (a
    setpoint, a second encoder), or whose correlation with the force is close to 1 (the same force again).
    """
    x, force = recording.position_m, recording.force_n
    v = np.gradient(x, recording.time_s)
    motion = np.column_stack([np.ones_like(x), x, x * x, v, np.sign(v)])
    motion[:, 1:] /= np.maximum(np.max(np.abs(motion[:, 1:]), axis=0), 1e-300)
    others = []
    for column in recording.further:
        values = np.unwrap(column.values) if column.unit == "rad" else column.values
        left = values - motion @ np.linalg.lstsq(motion, values, rcond=1e-9)[0]
        again = force is not None and abs(np.corrcoef(values, force)[0, 1]) > _AGAIN
        if np.var(left) > (1.0 - _OWN) * np.var(values) and not again:
            others.append(column)
    return replace(recording, further=tuple(others))


_LEAST_HZ = 30.0
WIDEST = 0.45  # cutoff of the sampling rate, at most
_SHARE = 0.9
_BEYOND = 1.2
MOST_ROWS = 9_000
"""Of the regression, at twice the cutoff: some 5 s of processor time."""
_SLOW_MOTION, _SLOW_FORCE = 0.95, 0.99  # of the power of speed and force below half of a lower cutoff


def cutoff_hz(recording: Recording, force_n: Floats) -> float:
    """Cutoff in Hz: 1.2 times the frequency below which lies 90 % of the force's power that goes with the
    motion, within 30 Hz and 0.45 of the sampling rate; the lower end for a short piece. A long recording
    gets less, the cutoff at which it has `MOST_ROWS`, if motion and force are slower than half of that.
    """
    rate = recording.rate_hz
    most, least = WIDEST * rate, min(_LEAST_HZ, WIDEST * rate)
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
    """1.5 standard deviations of the speed at rest, in the band up to `reach_hz`, of even positions."""
    band = min(reach_hz, 0.5 * rate_hz)
    noise = position_noise_m(position_m, rate_hz)
    speed = noise * float(np.sqrt(2.0 / rate_hz)) * 2.0 * np.pi * band**1.5 / float(np.sqrt(3.0))
    usual = float(np.quantile(np.abs(np.diff(position_m)) * rate_hz, 0.95))
    return float(max(1.5 * speed, 2e-4 * usual, 1e-12))


def gapless(recording: Recording) -> list[slice]:
    """Stretches in which at most three samples in a row are missing."""
    return recording.segments(max(0.1, 3.5 / recording.rate_hz))


def longest_piece(recording: Recording) -> slice:
    return max(gapless(recording), key=lambda s: s.stop - s.start)


def position_noise_m(position_m: Floats, rate_hz: float) -> float:
    """Standard deviation of the position's noise, the smaller of two estimates, for motion enters both.

    From third differences, the largest tenth left out; from the level at the end of the spectrum.
    """
    size = np.abs(np.diff(position_m, 3))
    usual = size[size <= np.quantile(size, 0.9)]
    by_difference = float(np.sqrt(np.mean(usual**2))) / float(np.sqrt(20.0)) / 0.79
    power = _spectrum(position_m, rate_hz)[1]
    by_level = float(np.sqrt(np.median(power[int(0.8 * len(power)) :]) * rate_hz / 2.0))
    return min(by_difference, by_level)


def _spectrum(position_m: Floats, rate_hz: float) -> tuple[Floats, Floats]:
    """Frequency in Hz and power of a position, by a window whose flanks are low."""
    count = int(min(len(position_m), max(128, 3.0 * rate_hz)))
    frequency_hz, power = welch(position_m, rate_hz, "blackmanharris", nperseg=count, detrend="linear")
    return frequency_hz, power
