"""Recordings of minutes to hours: the search on stretches, the fit to everything.

1. Faults of the sensor are looked for in all chunks.
2. The liveliest stretch of up to 60 s is analysed like any recording.
3. Its structure is fitted to all chunks. Where it leaves more of some chunks than of the stretch, something
   is local or slow (a puncture, drift): half of the stretch, stretches over the whole length and the worst
   chunks are analysed together, at their own times, and the structure that leaves less of held-out chunks is
   kept.
4. Coefficients, shapes, intervals and the gain are those of all chunks.

Time and memory beyond the recording itself do not depend on its length, but for 1 and 3, which are linear.
Not seen: what shows in less of a chunk than raises its rms by half.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from forefeel.common.causes.candidate import Model, base_name
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.analysis import Analysis, analyse, residual_rms_n
from forefeel.diagnosis.diagnose.band import cutoff_hz
from forefeel.diagnosis.diagnose.blocks import RmsGain
from forefeel.diagnosis.diagnose.chunks import chunks_of, cleaned_everywhere, liveliest
from forefeel.diagnosis.diagnose.judge import model_error
from forefeel.diagnosis.diagnose.parameters import told
from forefeel.diagnosis.diagnose.regression import ModelFit
from forefeel.diagnosis.diagnose.search import Search
from forefeel.diagnosis.diagnose.signals import Mask
from forefeel.diagnosis.diagnose.verdict import Diagnosis, HeldOut
from forefeel.diagnosis.diagnose.whole import Fitted, Whole, cut, fitted, gain_of

FLAG = "searched_on_stretches"
_LONG = 30_000
_STRETCH_S, _STRETCH_SAMPLES, _LEAST_S = 60.0, 20_000, 6.0
_MOST_ROWS = 9_000
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

Judge = Callable[[Analysis, Callable[[ModelFit], ModelFit]], tuple[Diagnosis, Analysis]]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Everywhere:
    """The analysis of stretches, and its structure fitted to all chunks, without any cause and with all.

    `gaps`: whether the recording itself has gaps.
    """

    gaps: bool
    analysis: Analysis
    whole: Whole
    before: Fitted
    after: Fitted

    def fit(self, fit: ModelFit) -> ModelFit:
        """A model of the stretches, fitted to all chunks."""
        return self.after.fit if fit.model == self.after.fit.model else fitted(self.whole, fit).fit


def stretch_s(recording: Recording) -> float:
    """How much is searched at once, in s: 60 s or 20,000 samples, less where the force is fast."""
    return min(_usual_s(recording), _fast_s(recording))


def is_long(recording: Recording) -> bool:
    """Whether a recording is searched on stretches; others are searched whole."""
    if len(recording) > _LONG:
        return recording.duration_s > 1.5 * stretch_s(recording)
    return recording.duration_s > 1.5 * _fast_s(recording)


def _usual_s(recording: Recording) -> float:
    return max(_STRETCH_S, _STRETCH_SAMPLES / recording.rate_hz)


def _fast_s(recording: Recording) -> float:
    """What gives so many rows of the regression, judged by the middle of the recording."""
    count = int(min(_PROBE_S * recording.rate_hz, len(recording)))
    middle = (len(recording) - count) // 2
    part = cut(recording, slice(middle, middle + count))
    assert part.force_n is not None
    return max(_LEAST_S, _MOST_ROWS / (2.0 * cutoff_hz(part, part.force_n)))


def analyse_long(
    recording: Recording,
    progress: Progress = lambda stage: None,
    names: Sequence[str] | None = None,
    parts_s: tuple[float, ...] = (),
) -> Everywhere:
    """The structure of the stretches, fitted everywhere; see the module. `names`, `parts_s`: as in `analyse`.

    Raises:
        ValueError: no stretch without gaps is long enough.
    """
    chunks = chunks_of(recording, float(np.clip(recording.duration_s / 16.0, 10.0, _CHUNK_S)))
    progress("sensor, in chunks")
    cleaned, unusable, faults = cleaned_everywhere(recording, chunks_of(recording, _RARE_S))
    how = Stretches(chunks, progress, names, parts_s)
    found = _searched(cleaned, unusable, how)
    if any(fault.name == "sensor_spikes" for fault in faults):
        raw = fitted(replace(found.whole, recording=recording), found.after.fit, steps=0)
        if raw.total_rms_n() < found.after.total_rms_n():  # pulses that the motion explains are no spikes
            found = _searched(recording, unusable, how)
            faults = [fault for fault in faults if fault.name != "sensor_spikes"]
    known = {fault.name for fault in found.analysis.cleaned.faults}
    found.analysis.cleaned.faults += [fault for fault in faults if fault.name not in known]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """How stretches are searched: the chunks of the whole, and the arguments of `analyse_long`."""

    chunks: list[slice]
    progress: Progress
    names: Sequence[str] | None
    parts_s: tuple[float, ...]


def _searched(recording: Recording, unusable: Mask, how: Stretches) -> Everywhere:
    """From the liveliest stretch, and from more where that does not do."""
    length_s = stretch_s(recording)
    lively = liveliest(recording, length_s)
    how.progress("the liveliest stretch")
    analysis = analyse(cut(recording, lively), how.progress, how.names)
    found = _everywhere(recording, unusable, how, analysis)
    others = _stretches(recording, found, how.chunks, lively, length_s)
    if others is None:
        return found
    how.progress("stretches of the whole length")
    again = _everywhere(recording, unusable, how, analyse(others, how.progress, how.names))
    return again if gain_of(found.whole, found.after, again.after).low > 0.0 else found


def diagnose_long(found: Everywhere, judge: Judge) -> tuple[Diagnosis, Analysis]:
    """The verdict on the stretches with the numbers of the whole, and the analysis that the model is of."""
    judged, analysis = judge(found.analysis, found.fit)
    if set(analysis.fit.model) != set(found.after.fit.model):
        model = {name: shape for name, shape in found.after.fit.model.items() if name in analysis.fit.model}
        found = replace(found, after=fitted(found.whole, analysis.regression.fit(model)))
    start_s, sense = analysis.regression.signals.origin_s, analysis.regression.sense
    gain = gain_of(found.whole, found.before, found.after)
    intervals = found.after.intervals(start_s, sense)
    causes = tuple(
        replace(cause, parameters=told(intervals.get(cause.name, cause.parameters)))
        for cause in judged.causes
    )
    force_n = found.before.force_n
    whole = replace(
        judged, causes=causes, flags=_flags(judged, found), held_out=_held_out(gain),
        baseline=model_error(gain.before_n, force_n, found.before.intervals(start_s, sense)),
        extended=model_error(gain.after_n, force_n, intervals),
    )  # fmt: skip
    return whole, replace(analysis, fit=found.after.fit)


def _everywhere(recording: Recording, unusable: Mask, how: Stretches, analysis: Analysis) -> Everywhere:
    analysis = _since_start(analysis, float(recording.time_s[0]))
    regression = analysis.regression
    whole = Whole(recording, unusable, how.chunks, regression, how.parts_s)
    fit = _in_phase(whole, analysis.fit) if "pulsation" in analysis.fit.model else analysis.fit
    after = fitted(whole, fit)
    for _ in range(2 if _changes(fit.model) else 0):
        after = fitted(whole, _changed_when(whole, after.fit), steps=0)
    for name in tuple(after.fit.model) if len(after.fit.model) > 1 else ():
        rest = {n: shape for n, shape in after.fit.model.items() if n != name}
        less = fitted(whole, regression.fit(rest), steps=0)
        if gain_of(whole, less, after).low <= _NOTHING:
            after = less
    analysis = replace(analysis, fit=regression.fit(after.fit.model))
    gaps = len(recording.segments()) > 1
    return Everywhere(gaps, analysis, whole, fitted(whole, regression.fit({"bias": ()})), after)


def _since_start(analysis: Analysis, start_s: float) -> Analysis:
    """The same with times that count from the whole recording's first stamp."""
    old = analysis.regression
    late_s = old.signals.origin_s - start_s
    old.signals.moved_to(start_s)
    new = old.like(old.signals)
    model = dict(analysis.fit.model)
    for name in _changes(model):
        model[name] = (model[name][0] + late_s,)
    return replace(analysis, regression=new, search=Search(new, analysis.search.names), fit=new.fit(model))


def _in_phase(whole: Whole, fit: ModelFit) -> ModelFit:
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


def _changed_when(whole: Whole, fit: ModelFit) -> ModelFit:
    """The instant of a change that leaves least: errors unchanged before it, changed after it."""
    (name,) = _changes(fit.model)
    total, least, best_s = 0.0, 0.0, 0.0
    for _, regression in whole.regressions():
        signals = regression.signals
        never = replace(fit, model={**fit.model, name: (np.inf,)})
        always = replace(fit, model={**fit.model, name: (-np.inf,)})
        errors = [regression.residual(trial)[signals.rows] ** 2 for trial in (never, always)]
        run = total + np.cumsum(errors[0] - errors[1])
        if run.min() < least:
            least, best_s = float(run.min()), float(signals.t[signals.rows][int(np.argmin(run))])
        total = float(run[-1])
    return replace(fit, model={**fit.model, name: (best_s,)})


def _changes(model: Model) -> list[str]:
    """The form of a change at an instant that a model holds, if it does."""
    return [name for name in model if base_name(name) == _CHANGE]


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


def _flags(judged: Diagnosis, found: Everywhere) -> tuple[str, ...]:
    """Of the recording, not of the stretches."""
    kept = [flag for flag in judged.flags if flag not in ("short", "gaps")]
    return (*kept, *(["gaps"] if found.gaps else []), FLAG)


def _held_out(gain: RmsGain) -> HeldOut:
    return HeldOut(gain.before_n, gain.after_n, gain.gain, gain.low, gain.high)
