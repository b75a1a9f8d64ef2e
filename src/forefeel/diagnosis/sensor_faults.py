"""Faults of the sensor, found on the force as recorded, before any filter.

A flat top piles samples up at one value; a comb has values only at multiples of a step; a spike stands alone;
a mains line is narrower than anything that a hand does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, median_filter, percentile_filter
from scipy.optimize import minimize_scalar
from scipy.signal import firwin, upfirdn
from scipy.stats import ks_2samp

from forefeel.common.causes.periodic import MainsHum
from forefeel.common.causes.sensor import SensorQuantisation, SensorSaturation, SensorSpikes
from forefeel.common.error_size import Floats
from forefeel.common.events.text import shown_unit
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.signals import Mask, longest_piece
from forefeel.diagnosis.verdict import Cause, Interval

MAINS_HZ = 50.0, 60.0
_PILE = 8.0
_LEAST_PILE = 0.002
_NEAR_LIMIT = 0.01  # of the force at which another recording was clipped
_SIDES = {"upper_n": 1.0, "lower_n": -1.0}  # ends of a range: a force times the sign reaches up to its size
_WHOLE = 0.02
_MOVED = 0.01  # of the range of positions
_MOST_CLIPPED = 0.5  # of the samples: more is how the force is made
_LINE = 8.0
_SLOW_HZ = 40.0  # sampling rate at which a line is looked for, shifted to zero; its lines reach +- 8 Hz
_FILTER_STEPS = 12  # length of the filter before it, in slow samples: 8 Hz pass, 32 Hz are stopped by 90 dB


@dataclass(slots=True, eq=False)
class Cleaned:
    """Force without lines and spikes, and the faults; `clipped`, `spikes`: where the raw one is void."""

    force_n: Floats
    clipped: Mask
    spikes: Mask
    faults: list[Cause] = field(default_factory=list)


def clean(recording: Recording, known: Sequence[Cause] = ()) -> Cleaned:
    """Finds saturation, quantisation, spikes and mains hum, and takes the last two out of a copy of the
    force. `recording`: has to have a force; it stays as it is. `known`: causes of another recording of the
    same sensor: if spikes are among them a single spike counts, and what is near a saturation's limit is
    clipped.
    """
    assert recording.force_n is not None
    force = np.array(recording.force_n)
    nowhere = np.zeros(len(force), dtype=np.bool_)
    cleaned = Cleaned(force, nowhere, nowhere.copy())
    step = comb_step(force)
    _saturation(cleaned, recording.position_m, step)
    for saturation in (cause.parameters for cause in known if cause.name == SensorSaturation.name):
        for end, side in _SIDES.items():
            if size := saturation.get(end, saturation.get("limit_n")):
                cleaned.clipped |= force * side >= size.value - _NEAR_LIMIT * abs(size.value)
    if step is not None:
        words = f"the force takes only {len(np.unique(force))} values, multiples of one step"
        parameters = {"step_n": Interval.about(step, 0.0005 * step)}
        cleaned.faults.append(Cause.on_readings(SensorQuantisation.name, parameters, words, step / 12.0**0.5))
    _spikes(cleaned, recording, step, any(cause.name == SensorSpikes.name for cause in known))
    _mains(cleaned, recording)
    return cleaned


def comb_step(force: Floats) -> float | None:
    """Step in N of a force whose values are multiples of one step, or None: the values are dense, fewer than
    three, or no such multiples.
    """
    levels = np.unique(force)
    if len(levels) < 3 or len(levels) > 0.2 * len(force) or len(levels) > 5000:
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * (levels[-1] - levels[0])]
    step = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.05)]))
    for _ in range(3):
        count = np.round(gaps / step)
        used = (count >= 1) & (count <= 3)
        if not used.any():
            return None
        step = float(np.mean(gaps[used] / count[used]))
    away = np.abs(gaps / step - np.round(gaps / step))
    return step if float(np.mean(away < _WHOLE)) > 0.95 else None


def _saturation(cleaned: Cleaned, position_m: Floats, step: float | None) -> None:
    """Marks samples at a flat top or bottom in `cleaned.clipped` and adds the fault; neither where that is
    over half of the samples, nor at rest, where any force is flat. `step`: of a comb of levels, None without
    one.
    """
    force = cleaned.force_n
    tops = {end: float(np.max(force * side)) for end, side in _SIDES.items()}
    ends: dict[str, float] = {}
    for end, top in tops.items():
        at = _piled(force * _SIDES[end], top, step)
        if at is not None and np.ptp(position_m[at]) > _MOVED * np.ptp(position_m):
            cleaned.clipped |= at
            ends[end] = top + 0.0  # no -0
    if ends and np.mean(cleaned.clipped) > _MOST_CLIPPED:
        cleaned.clipped = np.zeros_like(cleaned.clipped)  # a force of two levels has no top
    elif ends:
        share, range_n, largest = float(np.mean(cleaned.clipped)), sum(tops.values()), max(ends.values())
        limits = " and ".join(f"{_SIDES[end] * size + 0.0:.4g}" for end, size in ends.items())
        words = f"{100 * share:.2g} % of the samples stand exactly at {limits} {shown_unit('N')}"
        spread = 1e-3 * max(largest, 1e-3 * range_n) if step is None else 0.5 * step
        # a range is taken for symmetric unless it shows that it is not, as that of 0 to 10 N
        symmetric = max(tops.values()) <= largest + spread and min(ends.values()) >= largest - spread
        shown = {"limit_n": largest} if symmetric else ends
        parameters = {name: Interval.about(size, spread) for name, size in shown.items()}
        cleaned.faults.append(Cause.on_readings(SensorSaturation.name, parameters, words, share * range_n))


def _piled(force: Floats, top: float, step: float | None) -> Mask | None:
    """Mask of the samples at the top if far more of them are there than just below it, in runs; else None."""
    span = top - float(force.min())
    width = 1e-4 * span if step is None else 0.5 * step
    at = np.asarray(force > top - width)
    below = max(20.0 * width, 0.02 * span)
    beside = (
        np.count_nonzero((force > top - width - below) & ~at) * width / below * (1.0 if step is None else 2.0)
    )
    count = np.count_nonzero(at)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))
    longest = int(np.max(edges[1::2] - edges[::2], initial=0))
    runs = len(edges) // 2
    enough = count >= max(6.0, _LEAST_PILE * len(force)) and longest >= 4
    return at if enough and count > _PILE * max(beside, 0.5) and (step is None or runs >= 2) else None


def _mains(cleaned: Cleaned, recording: Recording) -> None:
    """Takes lines within 0.7 Hz of 50 or 60 Hz that the motion lacks, with harmonics up to the fifth, out of
    `cleaned.force_n`, and adds the fault. Passes over a line that the sampling rate can not show.
    """
    for nominal in MAINS_HZ:
        if recording.rate_hz < 2.2 * nominal:
            continue
        t, piece = recording.time_s - recording.time_s[0], longest_piece(recording)
        line = _line(t[piece], cleaned.force_n[piece], nominal)
        if line is None or _line(t[piece], recording.position_m[piece], nominal) is not None:
            continue
        frequency, level = line
        orders = [k for k in range(1, 6) if k * frequency < 0.45 * recording.rate_hz]
        harmonic = partial(_line, t[piece], cleaned.force_n[piece], reach=0.3)
        orders = [k for k in orders if k == 1 or harmonic(k * frequency) is not None]
        phase = 2.0 * np.pi * frequency * t[:, None] * np.array(orders)
        basis = np.hstack([np.sin(phase), np.cos(phase)])
        columns = np.column_stack([basis, cleaned.force_n])
        rough = columns - _smoothed(columns, recording.rate_hz, nominal)
        weights, *_ = np.linalg.lstsq(rough[:, :-1], rough[:, -1], rcond=None)
        wave = basis @ weights
        amplitude = float(np.hypot(weights[0], weights[len(orders)]))
        spread = np.sqrt(6.0) / np.pi / float(t[-1]) / level * 1.96
        cleaned.force_n = cleaned.force_n - wave
        parameters = {
            "frequency_hz": Interval.about(frequency, spread),
            "amplitude_n": Interval.about(amplitude, 1.96 * amplitude / level),
        }
        words = f"a line at {frequency:.2f} Hz, {level:.0f} times what is beside it, absent from the motion"
        cleaned.faults.append(Cause.on_readings(MainsHum.name, parameters, words, float(np.std(wave))))


def _line(t: Floats, values: Floats, nominal: float, reach: float = 0.7) -> tuple[float, float] | None:
    """(frequency in Hz, amplitude over what is beside it) of the strongest line within `reach` Hz of
    `nominal`, or None where none stands out or nothing is beside it, in under half a second; by heterodyning
    the first 120 s to zero. `t`: without gaps.
    """
    span = min(float(t[-1] - t[0]), 120.0)
    rows = t - t[0] <= span
    t, values = t[rows], values[rows]
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (t - t[0]) / max(span, 1e-9))
    rough = values - _smoothed(values, float(len(t) / max(span, 1e-9)), nominal)  # or the slow would alias
    shifted = rough * window * np.exp(-2j * np.pi * nominal * t)
    step = max(1, int(len(t) / (span * _SLOW_HZ)))
    slow = _decimated(shifted, step)
    power = np.abs(np.fft.fft(slow, 4 * len(slow)))
    offset = np.fft.fftfreq(4 * len(slow), step * float(np.median(np.diff(t))))
    near, beside = np.abs(offset) < reach, (np.abs(offset) > max(1.0, 4.0 / span)) & (np.abs(offset) < 8.0)
    if not beside.any():
        return None
    top = np.flatnonzero(near)[int(np.argmax(power[near]))]
    level = float(power[top]) / max(float(np.median(power[beside])), 1e-300)
    if level < _LINE or power[top] < 4.0 * float(np.quantile(power[beside], 0.98)):
        return None
    fine = minimize_scalar(
        lambda f: -abs(np.mean(shifted * np.exp(-2j * np.pi * f * t))),
        bounds=(offset[top] - 1.0 / span, offset[top] + 1.0 / span), method="bounded",
    )  # fmt: skip
    return nominal + float(fine.x), level


def _decimated(values: NDArray[np.complex128], step: int) -> NDArray[np.complex128]:
    """Every `step`-th value, low-passed before: a hand's tremor, shifted too, would alias to the mains."""
    if step == 1:
        return values
    taps = firwin(_FILTER_STEPS * step + 1, 0.6 / step, window="blackmanharris")
    return np.asarray(upfirdn(taps, values, 1, step))


def _smoothed(values: Floats, rate_hz: float, nominal: float) -> Floats:
    reach = rate_hz / (2.0 * np.pi * 0.3 * nominal)
    return np.asarray(gaussian_filter1d(values, reach, axis=0, mode="nearest"))


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


def _spikes(cleaned: Cleaned, recording: Recording, step_n: float | None, known: bool) -> None:
    """Replaces spikes in `cleaned.force_n` by the running median, marks them in `cleaned.spikes`, adds the
    fault. Does nothing if no spike, or over 2 % of the samples, are certain; unless `known` also if fewer
    than four are, or they come mostly at rest or at certain times after reversals.

    `step_n`: of a comb of levels, if there is one: its flips are no spikes.
    """
    force = cleaned.force_n
    size = max(5, 2 * int(0.5 * _MEDIAN_S * recording.rate_hz) + 1)
    smooth = median_filter(force, size, mode="nearest")
    off = force - smooth
    usual = max(_usual(off, step_n), 1e-9 * float(np.ptp(force)))
    width = 2 * max(8, int(0.25 * recording.rate_hz)) + 1
    scale = np.maximum(percentile_filter(np.abs(off), 85, width, mode="nearest"), usual)
    widest = max(3, round(0.004 * recording.rate_hz))
    certain = _isolated(force, off, _runs(off, _OUTLIER * scale), widest)
    if not (1 if known else _LEAST_SPIKES) <= len(certain[0]) <= 0.02 * len(force):
        return
    rest = _at_rest(recording)
    if not known and np.mean(rest[certain[0]]) > 0.3 + 2.0 * np.mean(rest):  # play, not the sensor
        return
    starts, stops = _runs(off, _ANOTHER * scale)  # that there are spikes is certain: these are some, too
    short = stops - starts <= widest
    starts, stops = starts[short], stops[short]
    sizes = _sizes(off, starts, stops)
    high = sizes > _LEAST_OF_USUAL * np.median(_sizes(off, *certain))  # smaller ones are corners of the force
    where = np.zeros(len(force), dtype=np.bool_)
    for start, stop in zip(starts[high], stops[high], strict=True):
        where[max(start - 1, 0) : stop + 1] = True
    if not known and _come_with_the_motion(where, recording):
        return
    sizes, without = sizes[high], np.where(where, smooth, force)
    count, amplitude, spread = len(sizes), float(np.mean(sizes)), 1.96 * float(np.std(sizes))
    parameters = {
        "rate_hz": Interval.about(count / recording.sampled_s, 1.96 * count**0.5 / recording.sampled_s),
        "amplitude_n": Interval.about(amplitude, spread / count**0.5),
    }
    words = (
        f"{count} isolated outliers of {amplitude:.3g} {shown_unit('N')}, "
        f"{amplitude / usual:.0f} times the usual distance from their neighbours"
    )
    rms_n = float(np.sqrt(np.mean((force - without) ** 2)))
    cleaned.faults.append(Cause.on_readings(SensorSpikes.name, parameters, words, rms_n))
    cleaned.force_n, cleaned.spikes = without, where


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
    """Mask of samples whose speed, over about 10 ms, is below an eighth of its usual size."""
    reach = max(1, round(0.005 * recording.rate_hz))
    x, t = recording.position_m, recording.time_s
    low, high = np.maximum(np.arange(len(x)) - reach, 0), np.minimum(np.arange(len(x)) + reach, len(x) - 1)
    speed = np.abs(x[high] - x[low]) / (t[high] - t[low])
    return np.asarray(speed < 0.125 * np.quantile(speed, 0.9))


def _come_with_the_motion(where: Mask, recording: Recording) -> bool:
    """True if outliers come at certain times after a reversal, as impacts do: those are of the contact. False
    with fewer than 4 reversals or 5 outliers.
    """
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
    """Runs of at most `widest` samples to and from which the force jumps sharply, and after which it is where
    it was: no step, no pulse that decays. `off`: force less its running median.
    """
    starts, stops = runs
    if not len(starts):
        return runs
    before, after = force[np.maximum(starts - 2, 0)], force[np.minimum(stops + 1, len(force) - 1)]
    size = _sizes(off, starts, stops)
    alone = (stops - starts <= widest) & (np.abs(after - before) < 0.25 * size)
    sharp = np.array([_sharp(force, a, b) for a, b in zip(starts, stops, strict=True)], dtype=np.bool_)
    return starts[alone & sharp], stops[alone & sharp]


def _cores(off: Floats, starts: NDArray[np.int64], stops: NDArray[np.int64]) -> Ends:
    """Runs narrowed to what is above 0.3 of their peak: a spike bends the median beside it."""
    first, last = starts.copy(), stops.copy()
    for i, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        size = np.abs(off[start:stop])
        high = np.flatnonzero(size > 0.3 * size.max())
        first[i], last[i] = start + high[0], start + high[-1] + 1
    return first, last


def _sharp(force: Floats, start: int, stop: int) -> bool:
    """True if the force jumps there and back, three times as far as it steps beside; a corner does not."""
    steps = np.abs(np.diff(force))
    beside = np.concatenate([steps[max(start - 7, 0) : max(start - 1, 0)], steps[stop : stop + 6]])
    if not 0 < start <= stop < len(force):
        return False
    return bool(min(steps[start - 1], steps[stop - 1]) > 3.0 * np.max(beside, initial=0.0))
