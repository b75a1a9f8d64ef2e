"""Recordings of minutes to hours: the search on stretches, the fit to everything.

1. Faults of the sensor are looked for in all chunks.
2. The liveliest stretch of up to 80 s is analysed like any recording.
3. Its structure is fitted to all chunks. Where it leaves more of some chunks than of the stretch, something
   is local or slow (a puncture, drift): half of the stretch, stretches over the whole length and the worst
   chunks are analysed together, at their own times, and the structure that leaves less of held-out chunks is
   kept.
4. Coefficients, shapes, intervals and the gain are those of all chunks.

Time and memory beyond the recording itself do not depend on its length, but for 1 and 3, which are linear.
Not seen: what shows in less of a chunk than raises its rms by half.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from common.recording.recording import Recording
from diagnosis.diagnose.analysis import Analysis, analyse, residual_rms_n
from diagnosis.diagnose.band import cutoff_hz
from diagnosis.diagnose.blocks import Gain
from diagnosis.diagnose.faults import Fault, clean
from diagnosis.diagnose.regression import Fit, Regression
from diagnosis.diagnose.search import Search
from diagnosis.diagnose.signals import Mask
from diagnosis.diagnose.verdict import Diagnosis, HeldOut, Stage
from diagnosis.diagnose.whole import Fitted, Whole, cut, fitted, gain_of

FLAG = "searched_on_stretches"
_LONG = 150_000
_STRETCH_S = 80.0
_MOST_FINE = 1.2e6
_PROBE_S = 20.0
_CHUNK_S = 60.0
_SPREAD, _WORST = 6, 3
_MORE, _MUCH_MORE = 1.15, 1.5
_CHANGE = "stiffness_change"
_RARE_S = 300.0
"""Faults are looked for in so much at once, for some are rare."""
_NOTHING = 1e-3
"""A cause stays when it lets the held-out error fall by more than this share."""
_HALF = 0.15

Judge = Callable[[Analysis], Diagnosis]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Everywhere:
    """The analysis of stretches, and its structure fitted to all chunks, without any cause and with all."""

    analysis: Analysis
    before: Fitted
    after: Fitted


def stretch_s(recording: Recording) -> float:
    """How much is searched at once: 80 s, less where the force is fast. In s."""
    count = int(min(_PROBE_S * recording.rate_hz, len(recording)))
    middle = (len(recording) - count) // 2
    part = cut(recording, slice(middle, middle + count))
    assert part.force_n is not None
    return float(np.clip(_MOST_FINE / (16.0 * cutoff_hz(part, part.force_n)), 6.0, _STRETCH_S))


def is_long(recording: Recording) -> bool:
    """Whether a recording is searched on stretches; others are searched whole."""
    return len(recording) > _LONG and recording.duration_s > 1.5 * stretch_s(recording)


def analyse_long(recording: Recording, progress: Progress = lambda stage: None) -> Everywhere:
    """The structure of the stretches, fitted everywhere; see the module.

    Raises:
        ValueError: no stretch without gaps is long enough.
    """
    length_s = stretch_s(recording)
    chunks = chunks_of(recording, float(np.clip(recording.duration_s / 16.0, 10.0, _CHUNK_S)))
    progress("sensor, in chunks")
    cleaned, unusable, faults = cleaned_everywhere(recording, chunks_of(recording, _RARE_S))
    lively = liveliest(cleaned, length_s)
    progress("the liveliest stretch")
    found = _everywhere(cleaned, unusable, chunks, analyse(cut(cleaned, lively), progress))
    others = _stretches(cleaned, found, chunks, lively, length_s)
    if others is not None:
        progress("stretches of the whole length")
        again = _everywhere(cleaned, unusable, chunks, analyse(others, progress))
        if gain_of(found.after, again.after).low > 0.0:
            found = again
    known = {fault.name for fault in found.analysis.cleaned.faults}
    found.analysis.cleaned.faults += [fault for fault in faults if fault.name not in known]
    return found


def diagnose_long(found: Everywhere, judge: Judge) -> tuple[Diagnosis, Analysis]:
    """The verdict on the stretches with the numbers of the whole, and the analysis that the model is of."""
    analysis = found.analysis
    start_s, sense = analysis.regression.signals.origin_s, analysis.regression.sense
    judged = judge(analysis)
    gain = gain_of(found.before, found.after)
    intervals = found.after.intervals(start_s, sense)
    causes = tuple(
        replace(cause, parameters=intervals.get(cause.name, cause.parameters)) for cause in judged.causes
    )
    named = {
        f"{name}.{key}" if name else key: interval.value
        for name, values in intervals.items()
        for key, interval in values.items()
    }
    base = dict(zip(intervals[""], map(float, found.before.fit.coefficients * sense), strict=True))
    whole = replace(
        judged, causes=causes, flags=(*judged.flags, FLAG), held_out=_held_out(gain),
        baseline=Stage(gain.before_n, base), extended=Stage(gain.after_n, named),
    )  # fmt: skip
    return whole, replace(analysis, fit=found.after.fit)


def chunks_of(recording: Recording, length_s: float) -> list[slice]:
    """The recording in pieces of about that length, none across a gap, none shorter than 3 s."""
    found = []
    for piece in recording.segments(max(0.1, 3.5 / recording.rate_hz)):
        time_s = recording.time_s[piece]
        count = max(1, round(float(time_s[-1] - time_s[0]) / length_s))
        edges = np.linspace(piece.start, piece.stop, count + 1).astype(np.int64)
        parts = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        found += [p for p in parts if recording.time_s[p.stop - 1] - recording.time_s[p.start] >= 3.0]
    return found


def cleaned_everywhere(recording: Recording, chunks: list[slice]) -> tuple[Recording, Mask, list[Fault]]:
    """Without lines and spikes of the force, which samples were clipped, the faults of all chunks merged."""
    assert recording.force_n is not None
    force_n, unusable = np.array(recording.force_n), np.zeros(len(recording), dtype=np.bool_)
    seen: dict[str, list[tuple[Fault, float]]] = defaultdict(list)
    for chunk in chunks:
        part = cut(recording, chunk)
        cleaned = clean(part)
        force_n[chunk], unusable[chunk] = cleaned.force_n, cleaned.clipped
        for fault in cleaned.faults:
            seen[fault.name].append((fault, part.duration_s))
    total = sum(float(recording.time_s[c.stop - 1] - recording.time_s[c.start]) for c in chunks)
    merged = [_merged(found, total) for found in seen.values()]
    cleaned_recording = replace(recording, force_n=force_n)
    return cleaned_recording, unusable, [fault for fault in merged if fault is not None]


def liveliest(recording: Recording, length_s: float) -> slice:
    """The stretch of that length with the longest way."""
    count = min(int(length_s * recording.rate_hz), len(recording))
    step = max(1, int(0.05 * recording.rate_hz))
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(recording.position_m[::step])))])
    reach = max(1, min(count // step, len(way) - 1))
    start = int(np.argmax(way[reach:] - way[:-reach])) * step
    return slice(start, min(start + count, len(recording)))


def _everywhere(recording: Recording, unusable: Mask, chunks: list[slice], analysis: Analysis) -> Everywhere:
    analysis = _since_start(analysis, float(recording.time_s[0]))
    regression = analysis.regression
    whole = Whole(recording, unusable, chunks, regression)
    fit = _in_phase(whole, analysis.fit) if "pulsation" in analysis.fit.model else analysis.fit
    after = fitted(whole, fit)
    for _ in range(2 if _CHANGE in fit.model else 0):
        after = fitted(whole, _changed_when(whole, after.fit), steps=0)
    for name in tuple(after.fit.model) if len(after.fit.model) > 1 else ():
        rest = {n: shape for n, shape in after.fit.model.items() if n != name}
        less = fitted(whole, regression.fit(rest), steps=0)
        if gain_of(less, after).low <= _NOTHING:
            after = less
    analysis = replace(analysis, fit=regression.fit(after.fit.model))
    return Everywhere(analysis, fitted(whole, regression.fit({})), after)


def _since_start(analysis: Analysis, start_s: float) -> Analysis:
    """The same with times that count from the whole recording's first stamp."""
    old = analysis.regression
    late_s = old.signals.origin_s - start_s
    old.signals.moved_to(start_s)
    new = Regression(old.signals, old.extent.speed_band)
    new.extent, new.sense = old.extent, old.sense
    new.whiten_by(old.noise)
    model = dict(analysis.fit.model)
    if _CHANGE in model:
        model[_CHANGE] = (model[_CHANGE][0] + late_s,)
    return replace(analysis, regression=new, search=Search(new), fit=new.fit(model))


def _in_phase(whole: Whole, fit: Fit) -> Fit:
    """The frequency of pulses by how their phase runs from chunk to chunk; of its half there is no trace."""
    owners = np.array(fit.owners)
    own, rest = np.flatnonzero(owners == "pulsation"), np.flatnonzero(owners != "pulsation")
    start = fitted(whole, fit, steps=0)
    middle_s, waves = [], []
    for number, sums in start.sums.items():
        left = np.asarray(sums.moment[own] - sums.gram[np.ix_(own, rest)] @ start.fit.coefficients[rest])
        c = np.linalg.lstsq(sums.gram[np.ix_(own, own)], left, rcond=None)[0]
        waves.append(c[:3] + 1j * c[3:])
        chunk = whole.chunks[number]
        middle_s.append(float(whole.recording.time_s[chunk].mean()))
    order = int(np.argmax(np.sum(np.abs(np.array(waves)), axis=0)))
    phase = np.unwrap(np.angle(np.array(waves)[:, order]))
    if len(phase) < 3:
        return fit
    off_hz = float(np.polyfit(middle_s, phase, 1)[0]) / (2.0 * np.pi * (order + 1))
    turn = np.exp(-2j * np.pi * off_hz * np.outer(middle_s, [1.0, 2.0, 3.0]))
    size = np.abs(np.mean(np.array(waves) * turn, axis=0))
    twice = 2.0 if order == 1 and size[0] < _HALF * size[1] and size[2] < _HALF * size[1] else 1.0
    return replace(fit, model={**fit.model, "pulsation": (twice * (fit.model["pulsation"][0] + off_hz),)})


def _changed_when(whole: Whole, fit: Fit) -> Fit:
    """The instant of a change that leaves least: errors unchanged before it, changed after it."""
    total, least, best_s = 0.0, 0.0, 0.0
    for _, regression in whole.regressions():
        signals = regression.signals
        never = replace(fit, model={**fit.model, _CHANGE: (np.inf,)})
        always = replace(fit, model={**fit.model, _CHANGE: (-np.inf,)})
        errors = [regression.residual(trial)[signals.rows] ** 2 for trial in (never, always)]
        run = total + np.cumsum(errors[0] - errors[1])
        if run.min() < least:
            least, best_s = float(run.min()), float(signals.t[signals.rows][int(np.argmin(run))])
        total = float(run[-1])
    return replace(fit, model={**fit.model, _CHANGE: (best_s,)})


def _stretches(
    recording: Recording, found: Everywhere, chunks: list[slice], lively: slice, length_s: float
) -> Recording | None:
    """What to search next, as one recording with gaps; None where the first search left no chunk worse."""
    rms, usual = found.after.rms_n(), residual_rms_n(found.analysis)
    whole = float(np.sqrt(np.mean(np.array(list(rms.values())) ** 2)))
    if whole < _MORE * usual and max(rms.values()) < _MUCH_MORE * usual:
        return None
    worst = sorted(rms, key=lambda k: -rms[k])[:_WORST]
    spread = np.linspace(0, len(chunks) - 1, _SPREAD).astype(int).tolist()
    each = int(0.5 * length_s / (_SPREAD + _WORST) * recording.rate_hz)
    rows = np.zeros(len(recording), dtype=np.bool_)
    half = (lively.stop - lively.start) // 4
    middle = (lively.start + lively.stop) // 2
    rows[middle - half : middle + half] = True
    for number in {*worst, *spread}:
        centre = (chunks[number].start + chunks[number].stop) // 2
        rows[max(centre - each // 2, 0) : centre + each // 2] = True
    assert recording.force_n is not None
    return Recording(
        recording.name, recording.time_s[rows], recording.position_m[rows], recording.force_n[rows],
        recording.source,
    )  # fmt: skip


def _merged(found: list[tuple[Fault, float]], total_s: float) -> Fault | None:
    """One fault of all chunks; a comb or a line that most of the chunks lack is none."""
    longest, covered = max(found, key=lambda pair: pair[1])[0], sum(duration for _, duration in found)
    share = covered / total_s
    if longest.name in ("sensor_quantisation", "mains_hum") and share < 0.5:
        return None
    parameters = {
        key: _together([fault.parameters[key] for fault, _ in found], share if key == "rate_hz" else 1.0)
        for key in longest.parameters
    }
    rms_n = float(np.sqrt(np.mean([fault.rms_n**2 for fault, _ in found]) * share))
    return Fault(longest.name, parameters, longest.evidence, rms_n)


def _together(values: list[tuple[float, float, float]], share: float) -> tuple[float, float, float]:
    """Mean of the values and their intervals, narrower by the root of their number."""
    value, low, high = np.mean(values, axis=0)
    narrow = 1.0 / np.sqrt(len(values))
    return tuple(float(share * (value + narrow * off)) for off in (0.0, low - value, high - value))  # type: ignore[return-value]


def _held_out(gain: Gain) -> HeldOut:
    return HeldOut(gain.before_n, gain.after_n, gain.gain, gain.low, gain.high)
