"""The diagnosis of one recording: what is named, and with how much trust."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from forefeel.common.causes.catalogue import CANDIDATES, cause_class, refresh
from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import Floats
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording, joined
from forefeel.diagnosis.analysis import Analysis, Progress, analyse
from forefeel.diagnosis.expected_gain import with_expectation
from forefeel.diagnosis.judge import judged
from forefeel.diagnosis.long_recording import FLAG, analyse_long, is_long
from forefeel.diagnosis.residual import predictable_share
from forefeel.diagnosis.standard_tests import diagnosed_hold, diagnosed_step
from forefeel.diagnosis.verdict import LEAST_S, Diagnosis, ModelError

_LIKE_NOISE = 0.3
_NO_ANSWER = 0.98


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosed:
    """The verdict, the analysis that it rests on, and the recording: all of a long one, several as one."""

    diagnosis: Diagnosis
    analysis: Analysis
    recording: Recording


def diagnose(
    recording: Recording,
    progress: Progress = lambda stage: None,
    given: ContactModel | None = None,
    beside: Sequence[Recording] = (),
) -> Diagnosed:
    """Diagnoses a recording: names the causes that a mass-damper-spring simulation of it misses.

    Updates the candidates to the effects now installed, and runs numeric libraries on one thread meanwhile.

    Args:
        recording: position and force.
        progress: called with each stage before it starts.
        given: the simulation to compare with, in place of a fitted mass, damper and spring.
        beside: further recordings of the same bench, for one model of all; whole recordings are held out.

    Raises:
        RecordingError: no force, shorter than 3 s, no motion or mere noise for it, a force that never changes
            or is mere noise, too few samples in a row; recordings of different rates.
    """
    recordings = [recording, *beside]
    for one in recordings:
        check(one)
    refresh()
    with threadpool_limits(1):  # thousands of small products: threads only wait for each other
        return _diagnosed(recordings, progress, given)


def _diagnosed(recordings: list[Recording], progress: Progress, given: ContactModel | None) -> Diagnosed:
    """Diagnoses a step response or a ramp and hold by its own method; all others, and several recordings
    joined, by the search, long ones on stretches. Adds the flags of gaps and of length; takes `given`, if
    any, as the baseline. Raises RecordingError: see `diagnose`.
    """
    recording, parts_s = _joined(recordings)
    simple = None if parts_s else diagnosed_step(recording) or diagnosed_hold(recording)
    long = simple is None and is_long(recording)
    if simple is None:
        # recordings share no clock: what has an instant or a phase of its own is not searched in several
        names = [name for name in CANDIDATES if not cause_class(name).clocked] if parts_s else None
        analysis = (analyse_long if long else analyse)(recording, progress, names, parts_s)
        simple = _judge_analysis(analysis, progress)
    diagnosis, analysis = simple
    gaps = any(len(one.segments()) > 1 for one in recordings)
    diagnosis = replace(diagnosis, flags=_flags(diagnosis.flags, gaps, long))
    if given is not None:
        diagnosis = _with_baseline(diagnosis, analysis, given)
    return Diagnosed(diagnosis, analysis, recording)


def _judge_analysis(analysis: Analysis, progress: Progress) -> tuple[Diagnosis, Analysis]:
    """Judges an analysis; returns the diagnosis, with the expected gain and the result of the plain
    regressions (`look`), and the analysis of the causes kept. Raises RecordingError where the force is flat
    but for noise.
    """
    if _force_is_noise(analysis):
        raise RecordingError(
            f"{analysis.recording.source}: the force is flat but for noise, expected an answer to the motion"
        )
    progress("trust")
    diagnosis, analysis = judged(analysis)
    return with_expectation(replace(diagnosis, look=analysis.regression.look), analysis), analysis


def _flags(flags: Sequence[str], gaps: bool, long: bool) -> tuple[str, ...]:
    """Flags with `gaps` as given, whatever the analysed stretches had; of a `long` recording with
    `searched_on_stretches` and without `short`.
    """
    other = [flag for flag in flags if flag != "gaps" and not (long and flag == "short")]
    return (*other, *(["gaps"] if gaps else []), *([FLAG] if long else []))


def _with_baseline(diagnosis: Diagnosis, analysis: Analysis, given: ContactModel) -> Diagnosis:
    """Copy of the diagnosis whose `baseline` is the given simulation: its rms error in N over the rows that
    count, and its parameters as `effect.parameter`, without intervals.
    """
    regression = analysis.regression
    force, rows = regression.signals.force, regression.signals.rows
    rms_n = float(np.sqrt(np.mean((force - regression.force_of(given))[rows] ** 2)))
    force_n = float(np.std(force[rows]))
    parameters = {f"{e.effect}.{key}": value for e in given.effects for key, value in e.parameters}
    return replace(diagnosis, baseline=ModelError(rms_n, parameters, 100.0 * (1.0 - rms_n / force_n)))


def check(recording: Recording) -> None:
    """Refuses a recording that can not be diagnosed.

    Raises:
        RecordingError: no force, shorter than 3 s, a position that never changes or is noise or single jumps,
            or a force that never changes.
    """
    place = recording.source
    if recording.force_n is None:
        raise RecordingError(f"{place}: no force, expected a column with the measured force")
    if recording.duration_s < LEAST_S:
        raise RecordingError(f"{place}: {recording.duration_s:.3g} s long, expected at least {LEAST_S:g} s")
    if float(np.ptp(recording.position_m)) == 0.0:
        raise RecordingError(f"{place}: the position never changes, expected motion")
    if _is_noise(recording.position_m):
        raise RecordingError(f"{place}: the position is noise or single jumps, expected motion")
    if float(np.ptp(recording.force_n)) == 0.0:
        raise RecordingError(f"{place}: the force never changes, expected a measured force")


def _is_noise(values: Floats) -> bool:
    """True if the autocorrelation at lags of one to five samples is below 0.3 in size."""
    v = values - np.mean(values)
    power = float(v @ v)
    return all(abs(float(v[k:] @ v[:-k])) < _LIKE_NOISE * power for k in range(1, 6))


def _force_is_noise(analysis: Analysis) -> bool:
    """True if no cause (a bias is none) and no fault was found, mass, damper and spring leave over 98 % of
    the force's variance, and the residual's own past predicts less than 30 % of it.
    """
    regression = analysis.regression
    rows = regression.signals.rows
    residual = regression.residual(analysis.base)
    share = float(np.var(residual[rows]) / np.var(regression.signals.force[rows]))
    named = set(analysis.fit.model) - {"bias"} or analysis.faults
    return not named and share > _NO_ANSWER and predictable_share(regression, residual) < _LIKE_NOISE


_APART_S = 10.0  # s between two recordings: more than any gap within which samples belong together
_ALIKE = 1.1  # ratio of rates that one band and one grid do for


def _joined(recordings: Sequence[Recording]) -> tuple[Recording, tuple[float, ...]]:
    """Joins recordings in turn, 10 s apart, stamps from 0; returns also the middle of each gap in s. A single
    recording comes back as it is, with an empty tuple.

    Nothing is carried across a gap: frictions, plays and relaxations begin anew.

    Raises:
        RecordingError: rates that differ by more than a tenth.
    """
    first, *more = recordings
    if not more:
        return first, ()
    for recording in more:
        if not 1.0 / _ALIKE < recording.rate_hz / first.rate_hz < _ALIKE:
            raise RecordingError(
                f"{recording.source}: {recording.rate_hz:.4g} Hz beside {first.rate_hz:.4g} Hz of "
                f"{first.source}; expected recordings of one rate"
            )
    whole, starts = joined(recordings, _APART_S), np.cumsum([len(recording) for recording in recordings[:-1]])
    return whole, tuple((whole.time_s[starts] - 0.5 * _APART_S).tolist())
