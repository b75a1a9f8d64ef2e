"""Recordings of minutes to hours: stretches of them are analysed like any recording.

1. Faults of the sensor are looked for in all chunks.
2. The liveliest stretch of up to 60 s is analysed.
3. Its model is held against all chunks. Where it leaves more of some than of the stretch, something is local
   or slow (a puncture, drift): half of that stretch, short stretches over the whole length and the worst
   chunks are analysed together, at their own times, as one recording with gaps. Of several recordings as one
   this comes first, for each has to be seen.
4. An instant of change that fell between two stretches is looked for in all chunks, and laid into one.

The model that leaves less of all chunks is kept. Memory beyond the recording itself does not depend on its
length; time does for 1, 3 and 4, which are linear. Not seen: what shows in less of a chunk than raises its
rms by half.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.periodic import MainsHum
from forefeel.common.causes.sensor import SensorQuantisation, SensorSpikes
from forefeel.common.causes.wall import StiffnessChange
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Analysis, Progress, analyse
from forefeel.diagnosis.regression import RecordingRegression
from forefeel.diagnosis.sensor_faults import clean
from forefeel.diagnosis.signals import MOST_ROWS, Mask, Signals, cutoff_hz, gapless
from forefeel.diagnosis.verdict import Cause, Interval


def chunks_of(recording: Recording, length_s: float) -> list[slice]:
    """Cuts a recording into chunks of about that length, none across a gap; leaves out those below 3 s."""
    chunks = []
    for piece in gapless(recording):
        time_s = recording.time_s[piece]
        count = max(1, round(float(time_s[-1] - time_s[0]) / length_s))
        edges = np.linspace(piece.start, piece.stop, count + 1).astype(np.int64)
        parts = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        chunks += [p for p in parts if recording.time_s[p.stop - 1] - recording.time_s[p.start] >= 3.0]
    return chunks


def cleaned_everywhere(recording: Recording, chunks: list[slice]) -> tuple[Recording, Mask, list[Cause]]:
    """Cleans the force in each chunk; returns the recording with that force, the mask of clipped samples, and
    the faults merged by name. Samples outside the chunks stay as they are.
    """
    assert recording.force_n is not None
    force_n, unusable = recording.force_n, np.zeros(len(recording), dtype=np.bool_)
    by_name: dict[str, list[tuple[Cause, float]]] = defaultdict(list)
    for chunk in chunks:
        part = recording.cut(chunk)
        cleaned = clean(part)
        unusable[chunk] = cleaned.clipped
        if not np.array_equal(cleaned.force_n, recording.force_n[chunk]):
            if force_n is recording.force_n:
                force_n = recording.force_n.copy()  # not before: an hour at 1 kHz is 29 MB
            force_n[chunk] = cleaned.force_n
        for fault in cleaned.faults:
            by_name[fault.name].append((fault, part.duration_s))
    total = sum(float(recording.time_s[c.stop - 1] - recording.time_s[c.start]) for c in chunks)
    merged = [_merged(faults, total) for faults in by_name.values()]
    if force_n is not recording.force_n:
        force_n.flags.writeable = False  # handed over, not copied
        recording = replace(recording, force_n=force_n)
    return recording, unusable, [fault for fault in merged if fault is not None]


def liveliest(recording: Recording, length_s: float) -> slice:
    """Stretch of that length in which the position travels farthest."""
    count = min(int(length_s * recording.rate_hz), len(recording))
    step = max(1, int(0.05 * recording.rate_hz))
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(recording.position_m[::step])))])
    reach = max(1, min(count // step, len(way) - 1))
    start = int(np.argmax(way[reach:] - way[:-reach])) * step
    return slice(start, min(start + count, len(recording)))


def _merged(faults: list[tuple[Cause, float]], total_s: float) -> Cause | None:
    """Merges one fault found in several chunks, paired with their durations in s: means of its parameters;
    rate and rms over all of `total_s`. None for quantisation or mains hum in less than half of that time.
    """
    longest, covered = max(faults, key=lambda pair: pair[1])[0], sum(duration for _, duration in faults)
    share = covered / total_s
    if longest.name in (SensorQuantisation.name, MainsHum.name) and share < 0.5:
        return None
    parameters = {
        key: _together(
            [fault.parameters[key] for fault, _ in faults if key in fault.parameters],
            share if key == "rate_hz" else 1.0,
        )
        for key in longest.parameters
    }
    rms_n = float(np.sqrt(np.mean([fault.explained_n**2 for fault, _ in faults]) * share))
    return Cause.on_readings(longest.name, parameters, longest.evidence.words, rms_n)


def _together(intervals: list[Interval], share: float) -> Interval:
    """Interval about the mean value: mean interval over the root of their number; times `share`."""
    value, low, high = np.mean([(i.value, i.low, i.high) for i in intervals], axis=0)
    narrow = 1.0 / np.sqrt(len(intervals))
    ends = (float(share * (value + narrow * off)) for off in (0.0, low - value, high - value))
    return Interval(*ends)


FLAG = "searched_on_stretches"
_LONG = 30_000  # samples; a shorter recording is searched whole unless its force is fast
_STRETCH_S, _STRETCH_SAMPLES, _LEAST_S = 60.0, 20_000, 6.0  # searched at once, in s and samples
_MORE_THAN_ONE = 1.5  # times that length: a recording of less is searched whole
_PROBE_S = 20.0  # s in the middle of a recording by which its cutoff is judged
_CHUNKS, _CHUNK_S = 16.0, (10.0, 60.0)  # chunks of a recording, and bounds of their length in s
_SPREAD, _WORST = 6, 3  # short stretches over the whole length, and in the worst chunks
_MORE, _MUCH_MORE = 1.15, 1.5  # times the stretch's rms, of all chunks and of the worst
_LEAST_ROWS = 50  # of a chunk that is compared
_CHANGE = StiffnessChange.name
_RARE_S = 300.0  # s in which faults are looked for at once, for some are rare


def stretch_s(recording: Recording) -> float:
    """Length searched at once, in s: 60 s or 20,000 samples, the longer of both; less where the force is
    fast, judged by the middle of the recording.
    """
    count = int(min(_PROBE_S * recording.rate_hz, len(recording)))
    middle = (len(recording) - count) // 2
    fast_s = _with_most_rows_s(recording.cut(slice(middle, middle + count)))
    return min(max(_STRETCH_S, _STRETCH_SAMPLES / recording.rate_hz), fast_s)


def is_long(recording: Recording) -> bool:
    """True if a recording is to be searched on stretches; others are searched whole, slow ones decimated."""
    length_s = stretch_s(recording) if len(recording) > _LONG else _with_most_rows_s(recording)
    return recording.duration_s > _MORE_THAN_ONE * length_s


def _with_most_rows_s(recording: Recording) -> float:
    assert recording.force_n is not None
    return max(_LEAST_S, MOST_ROWS / (2.0 * cutoff_hz(recording, recording.force_n)))


def analyse_long(
    recording: Recording,
    progress: Progress = lambda stage: None,
    names: Sequence[str] | None = None,
    parts_s: tuple[float, ...] = (),
) -> Analysis:
    """Cleans a long recording in chunks and analyses stretches of it: the liveliest, and more where its model
    leaves more of others. Spikes that the motion explains are no fault: the raw force is then searched.
    `names`, `parts_s`: as in `analyse`.

    Raises:
        RecordingError: no stretch, or no piece, without gaps is long enough.
    """
    progress("sensor, in chunks")
    cleaned, unusable, faults = cleaned_everywhere(recording, chunks_of(recording, _RARE_S))
    chunks = chunks_of(recording, float(np.clip(recording.duration_s / _CHUNKS, *_CHUNK_S)))
    whole = Whole(cleaned, unusable, chunks, progress, names, parts_s)
    analysis = whole.searched()
    if any(fault.name == SensorSpikes.name for fault in faults):
        raw = Whole(recording, unusable, chunks, progress, names, parts_s)
        if raw.rms_n(analysis) < whole.rms_n(analysis):  # pulses that the motion explains are no spikes
            analysis = raw.searched()
            faults = [fault for fault in faults if fault.name != SensorSpikes.name]
    known = {fault.name for fault in analysis.cleaned.faults}
    analysis.cleaned.faults.extend(fault for fault in faults if fault.name not in known)
    return analysis


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A recording, its chunks, and how its stretches are searched.

    `unusable`: samples at the end of the load cell's range. The others are arguments of `analyse_long`.
    """

    recording: Recording
    unusable: Mask
    chunks: list[slice]
    progress: Progress
    names: Sequence[str] | None
    parts_s: tuple[float, ...]

    def searched(self) -> Analysis:
        """Analyses the liveliest stretch. If its model leaves 1.15 times that stretch's rms of all chunks, or
        1.5 times of one, analyses stretches over the whole length too and returns the analysis that leaves
        less of all chunks. Of several recordings joined it analyses a stretch of each at once.

        Raises:
            RecordingError: no chunk has 50 samples that count.
        """
        if self.parts_s:
            return self._analysed(self._stretches(range(0)))
        lively = np.zeros(len(self.recording), dtype=np.bool_)
        lively[liveliest(self.recording, stretch_s(self.recording))] = True
        self.progress("the liveliest stretch")
        analysis = self._analysed(lively)
        left_n = self.left_n(analysis)
        if not left_n:
            raise RecordingError(
                f"{self.recording.source}: no piece without gaps lasts 3 s or can be compared"
            )
        total_n, usual_n = _rms(left_n.values()), analysis.residual_rms_n
        if total_n < _MORE * usual_n and max(left_n.values()) < _MUCH_MORE * usual_n:
            return analysis
        self.progress("stretches of the whole length")
        rows = self._stretches(sorted(left_n, key=lambda number: -left_n[number])[:_WORST])
        again = self._around_the_change(self._analysed(rows), rows)
        return again if self.rms_n(again) < total_n else analysis

    def rms_n(self, analysis: Analysis) -> float:
        return _rms(self.left_n(analysis).values())

    def left_n(self, analysis: Analysis) -> dict[int, float]:
        """rms of the residual in N by number of the chunk."""
        return {
            number: _rms(regression.residual(analysis.fit)[regression.signals.rows])
            for number, regression in self._regressions(analysis)
        }

    def _regressions(self, analysis: Analysis) -> Iterator[tuple[int, RecordingRegression]]:
        """Yields number and regression of every chunk, with the cutoff, noise, look and origin of time of the
        analysis; skips one that is too short, or has fewer than 50 samples that count.
        """
        like = analysis.regression
        for number, chunk in enumerate(self.chunks):
            part = self.recording.cut(chunk)
            assert part.force_n is not None
            try:
                signals = Signals(part, part.force_n, like.signals.cutoff_hz, self.unusable[chunk])
            except RecordingError:  # too few samples in a row
                continue
            if np.count_nonzero(signals.rows) < _LEAST_ROWS:
                continue
            signals.moved_to(like.signals.origin_s)
            yield number, like.like(signals)

    def _analysed(self, rows: Mask) -> Analysis:
        """Analyses the samples of a mask as one recording with gaps."""
        part = self.recording.cut(rows)
        late_s = float(part.time_s[0] - self.recording.time_s[0])
        parts_s = tuple(part_s - late_s for part_s in self.parts_s)
        return analyse(part, self.progress, self.names, parts_s)

    def _stretches(self, worst: Sequence[int]) -> Mask:
        """Mask of the middle half of the liveliest stretch and, as long in sum, of equal pieces in the middle
        of six chunks over the whole length and of the `worst`, by number. Of joined recordings: of pieces in
        one chunk of each and in the `worst` alone, in sum one stretch long.
        """
        length_s = stretch_s(self.recording)
        rows = np.zeros(len(self.recording), dtype=np.bool_)
        if self.parts_s:
            spread, share = self._one_of_each(), 1.0
        else:
            spread, share = np.linspace(0, len(self.chunks) - 1, _SPREAD).astype(int).tolist(), 0.5
            lively = liveliest(self.recording, length_s)
            quarter = (lively.stop - lively.start) // 4
            rows[lively.start + quarter : lively.stop - quarter] = True
        chosen = {*spread, *worst}
        for number in chosen:
            centre = (self.chunks[number].start + self.chunks[number].stop) // 2
            self._include(rows, centre, share * length_s / len(chosen))
        return rows

    def _one_of_each(self) -> list[int]:
        """Number of the middle chunk of each of the joined recordings."""
        start_s = np.array([self.recording.time_s[chunk.start] for chunk in self.chunks])
        owners = np.searchsorted(self.parts_s, start_s - self.recording.time_s[0])
        groups = [np.flatnonzero(owners == owner) for owner in np.unique(owners)]
        return [int(numbers[len(numbers) // 2]) for numbers in groups]

    def _include(self, rows: Mask, centre: int, length_s: float) -> None:
        half = int(0.5 * length_s * self.recording.rate_hz)
        rows[max(centre - half, 0) : centre + half] = True

    def _around_the_change(self, analysis: Analysis, rows: Mask) -> Analysis:
        """Analyses anew with one stretch more, around the instant of a change of stiffness, if the model has
        one and all chunks place it outside `rows`; else returns the analysis as it is.
        """
        forms = [name for name in analysis.fit.model if base_name(name) == _CHANGE]
        if not forms:
            return analysis
        at_s = self._changed_s(analysis, forms[0])
        centre = int(np.searchsorted(self.recording.time_s, at_s))
        if rows[min(centre, len(rows) - 1)]:
            return analysis
        rows = rows.copy()
        self._include(rows, centre, stretch_s(self.recording) / (_SPREAD + _WORST))
        return self._analysed(rows)

    def _changed_s(self, analysis: Analysis, name: str) -> float:
        """Stamp in s of the change `name` of the fit that leaves the least error over all chunks,
        coefficients kept; that of the fit if none is better than a change before the first sample.
        """
        fit = analysis.fit
        total, least, best_s = 0.0, 0.0, fit.model[name][0]
        for _, regression in self._regressions(analysis):
            forms = [replace(fit, model={**fit.model, name: (at_s,)}) for at_s in (np.inf, -np.inf)]
            before, after = (regression.residual(form)[regression.signals.rows] ** 2 for form in forms)
            run = total + np.cumsum(before - after)
            if run.min() < least:
                least = float(run.min())
                best_s = float(regression.signals.t[regression.signals.rows][np.argmin(run)])
            total = float(run[-1])
        return best_s + analysis.regression.signals.origin_s


def _rms(values: Iterable[float]) -> float:
    return float(np.sqrt(np.mean(np.fromiter(values, dtype=np.float64) ** 2)))
