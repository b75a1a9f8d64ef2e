"""Spikes of a sensor: short outliers that stand alone, wherever the motion is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter, percentile_filter
from scipy.stats import ks_2samp

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.signals import Mask

_OUTLIER = 12.0
_ANOTHER = 5.0
"""Times the usual distance from the median of the neighbours: to know of spikes at all, then for each."""

_LEAST_SPIKES = 4
_LEAST_OF_USUAL = 0.35
_MEDIAN_S = 0.011
_SMOOTH_S = 0.02  # s over which the position is smoothed before its reversals are looked for
_LEAST_TURNS, _LEAST_OUTLIERS = 4, 5  # to tell whether the one comes with the other
_BY_CHANCE = 0.003  # probability (Kolmogorov and Smirnov) below which it is none that they do

Ends = tuple[NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True, slots=True, eq=False)
class Spikes:
    """Where they are, how high each is, the force without them, and the usual distance from neighbours."""

    where: Mask
    sizes_n: Floats
    without_n: Floats
    usual_n: float


def find_spikes(force: Floats, recording: Recording, step_n: float | None) -> Spikes | None:
    """None when there are few, or so many that they are no exception, or when they come with reversals.

    Args:
        force: in N, at the stamps of the recording.
        recording: of the motion.
        step_n: of a comb of levels, if there is one: its flips are no spikes.
    """
    size = max(5, 2 * int(0.5 * _MEDIAN_S * recording.rate_hz) + 1)
    smooth = median_filter(force, size, mode="nearest")
    off = force - smooth
    usual = max(_usual(off, step_n), 1e-9 * float(np.ptp(force)))
    width = 2 * max(8, int(0.25 * recording.rate_hz)) + 1
    scale = np.maximum(percentile_filter(np.abs(off), 85, width, mode="nearest"), usual)
    widest = max(3, round(0.004 * recording.rate_hz))
    certain = _isolated(force, off, _runs(off, _OUTLIER * scale), widest)
    if not _LEAST_SPIKES <= len(certain[0]) <= 0.02 * len(force):
        return None
    rest = _at_rest(recording)
    if np.mean(rest[certain[0]]) > 0.3 + 2.0 * np.mean(rest):  # play, not the sensor
        return None
    starts, stops = _runs(off, _ANOTHER * scale)  # that there are spikes is certain: these are some, too
    short = stops - starts <= widest
    starts, stops = starts[short], stops[short]
    sizes = _sizes(off, starts, stops)
    high = sizes > _LEAST_OF_USUAL * np.median(_sizes(off, *certain))  # smaller ones are corners of the force
    where = np.zeros(len(force), dtype=np.bool_)
    for start, stop in zip(starts[high], stops[high], strict=True):
        where[max(start - 1, 0) : stop + 1] = True
    if _come_with_the_motion(where, recording):
        return None
    return Spikes(where, sizes[high], np.where(where, smooth, force), usual)


def _usual(off: Floats, step_n: float | None) -> float:
    size = np.abs(off)
    spread = 1.4826 * float(np.median(size)), float(np.quantile(size, 0.9)) / 1.645
    return max(*spread, 0.3 * step_n if step_n else 0.0)


def _runs(off: Floats, limit: Floats) -> Ends:
    out = (np.abs(off) > limit).astype(np.int8)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], out, [0]])))
    return _cores(off, edges[::2], edges[1::2])


def _sizes(off: Floats, starts: NDArray[np.int64], stops: NDArray[np.int64]) -> Floats:
    return np.array([np.max(np.abs(off[a:b])) for a, b in zip(starts, stops, strict=True)])


def _at_rest(recording: Recording) -> Mask:
    """Where the speed, over about 10 ms, is below an eighth of its usual size."""
    reach = max(1, round(0.005 * recording.rate_hz))
    x, t = recording.position_m, recording.time_s
    low, high = np.maximum(np.arange(len(x)) - reach, 0), np.minimum(np.arange(len(x)) + reach, len(x) - 1)
    speed = np.abs(x[high] - x[low]) / (t[high] - t[low])
    return np.asarray(speed < 0.125 * np.quantile(speed, 0.9))


def _come_with_the_motion(where: Mask, recording: Recording) -> bool:
    """Whether outliers come at a certain time after a reversal, as impacts do: those are of the contact."""
    rate_hz = recording.rate_hz
    smooth = gaussian_filter1d(recording.position_m, _SMOOTH_S * rate_hz)
    direction = np.sign(np.diff(smooth, prepend=smooth[:1]))
    turned = np.flatnonzero(np.diff(direction) != 0.0)
    first = np.flatnonzero(np.diff(where.astype(np.int8), prepend=0) == 1)  # of neighbours one
    if len(turned) < _LEAST_TURNS or len(first) < _LEAST_OUTLIERS:
        return False
    last = np.searchsorted(turned, np.arange(len(where))) - 1
    since = np.arange(len(where)) - turned[np.maximum(last, 0)]
    return bool(ks_2samp(since[first], since[:: max(1, len(since) // 5000)]).pvalue < _BY_CHANCE)


def _isolated(force: Floats, off: Floats, runs: Ends, widest: int) -> Ends:
    """Those that are short, and after which the force is where it was: no step, no pulse that decays."""
    starts, stops = runs
    if not len(starts):
        return runs
    before, after = force[np.maximum(starts - 2, 0)], force[np.minimum(stops + 1, len(force) - 1)]
    size = _sizes(off, starts, stops)
    alone = (stops - starts <= widest) & (np.abs(after - before) < 0.25 * size)
    sharp = np.array([_sharp(force, a, b) for a, b in zip(starts, stops, strict=True)], dtype=np.bool_)
    return starts[alone & sharp], stops[alone & sharp]


def _cores(off: Floats, starts: NDArray[np.int64], stops: NDArray[np.int64]) -> Ends:
    """Each run without its flanks: a spike bends the median beside it."""
    first, last = starts.copy(), stops.copy()
    for i, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        size = np.abs(off[start:stop])
        high = np.flatnonzero(size > 0.3 * size.max())
        first[i], last[i] = start + high[0], start + high[-1] + 1
    return first, last


def _sharp(force: Floats, start: int, stop: int) -> bool:
    """Whether the force jumps there and back, three times as far as it steps beside; a corner does not."""
    steps = np.abs(np.diff(force))
    beside = np.concatenate([steps[max(start - 7, 0) : max(start - 1, 0)], steps[stop : stop + 6]])
    if not 0 < start <= stop < len(force):
        return False
    return bool(min(steps[start - 1], steps[stop - 1]) > 3.0 * np.max(beside, initial=0.0))
