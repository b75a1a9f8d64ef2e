"""The diagnosis of a motion that was asked for, held against the recording that left the question open.

The answer is diagnosed alone: together with the question no more is named, and drift, pulsation and hum can
not be. A model that is named has to hold on the question, which no fit has seen: of the models that do not,
most are wrong. Where the answer names none that does, a model of the question stands that holds on the
answer: a slow drift, a contact that the force limit has kept the answer away from.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, inf
from types import MappingProxyType
from typing import Literal

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Progress, conditioned
from forefeel.diagnosis.confirmation import Replay, confirm
from forefeel.diagnosis.diagnose import Diagnosed, check, diagnose
from forefeel.diagnosis.excitation import SECONDS, Limits, excitation
from forefeel.diagnosis.forecast import Forecast, Rivals
from forefeel.diagnosis.sensor_faults import clean
from forefeel.diagnosis.signals import WIDEST
from forefeel.diagnosis.verdict import Diagnosis

_SHARES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05)  # of the limits, of which the largest is taken that does
_SAME_RATE = 0.95  # of a rate, from which on another is the same


@dataclass(frozen=True, slots=True, eq=False)
class Investigation:
    """A question, and the motion that is asked for.

    Attributes:
        question: the recording that left it open.
        diagnosed: its diagnosis; None where its force is flat or no stretch of it is long enough.
        limits: that `motion`, without a force, stays within.
        forecasts: what each rival of the diagnosis says of the motion.
    """

    question: Recording
    diagnosed: Diagnosed | None
    limits: Limits
    motion: Recording
    forecasts: tuple[Forecast, ...]


def investigate(
    question: Recording | Diagnosed,
    limits: Mapping[str, float] = MappingProxyType({}),
    duration_s: float = SECONDS[1],
    progress: Progress = lambda stage: None,
) -> Investigation:
    """Makes the motion to record next, within what the recording has reached: the largest of eight sizes with
    which at least one rival's forecast stays within the force limit, or else the smallest. Diagnoses the
    recording first, unless it is `Diagnosed`; the largest size is taken where that fails, as of a flat force.

    `limits`: fields of `Limits`, in place of those reached; with any of them the force has a limit only where
    it is given.

    Raises:
        RecordingError: no force, shorter than 3 s, no motion.
        ConfigurationError: a motion of another duration than 10 to 60 s.
    """
    diagnosed: Diagnosed | None
    if isinstance(question, Diagnosed):
        diagnosed, question = question, question.recording
    else:
        check(question)
        diagnosed = _unless_flat(question, progress)
    regression = diagnosed.analysis.regression if diagnosed else conditioned(question, clean(question))
    bounds = Limits.reached(regression.signals)
    if limits:  # in another range the force is another
        bounds = replace(bounds, **{"force_n": inf, **limits})
    middle_m = float(np.clip(np.median(question.position_m), bounds.low_m, bounds.high_m))
    rivals = Rivals(diagnosed) if diagnosed else None
    for share in _SHARES:
        within = bounds.shrunk(share, middle_m)
        motion = excitation(within, duration_s, question.rate_hz)
        foretold = rivals.along(motion) if rivals else []
        if not foretold or min(forecast.most_n for forecast in foretold) <= bounds.force_n:
            break
    return Investigation(question, diagnosed, within, motion, tuple(foretold))


def _unless_flat(question: Recording, progress: Progress) -> Diagnosed | None:
    try:
        return diagnose(question, progress)
    except RecordingError:  # a force that is flat leaves all the more open
        return None


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Verdict on an answer.

    Attributes:
        diagnosed: `unexplained` where what the answer names was not confirmed.
        of: the recording that it is of: the question, where its model alone holds on the other one.
        refused: the diagnosis of the answer where it does not stand.
        replay: on the other recording; None where nothing was named, or the question can not be replayed.
    """

    diagnosed: Diagnosed
    of: Literal["answer", "question"]
    refused: Diagnosis | None
    replay: Replay | None


def judge(asked: Investigation, answer: Recording, progress: Progress = lambda stage: None) -> Judged:
    """Diagnoses the recording `answer` of the motion that `asked` made, and decides which diagnosis holds.

    Causes of the answer hold unless their model is `not_confirmed` on the first recording. Else those of the
    first hold if their model is confirmed on the answer, without cautions; else the verdict on the answer,
    `unexplained` where it named causes. The next motion is dropped unless it is described in words. Where
    the first recording has too low a rate for the answer's band, the answer is diagnosed at that rate.

    Raises:
        RecordingError: the answer can not be diagnosed.
    """
    question, alone = asked.question, _unasked(diagnose(answer, progress))
    if (
        alone.diagnosis.names_causes
        and alone.analysis.regression.signals.cutoff_hz > WIDEST * question.rate_hz
    ):
        every = ceil(_SAME_RATE * answer.rate_hz / question.rate_hz)
        alone = _unasked(diagnose(answer.cut(slice(None, None, every)), progress))
    named, replay = alone.diagnosis, None
    if named.names_causes:
        progress("confirmation")
        replay = _replayed(alone, question)
        if replay is None or replay.confirmation.verdict != "not_confirmed":
            return Judged(alone, "answer", None, replay)
    refused = named if replay else None
    if asked.diagnosed is not None and asked.diagnosed.diagnosis.verdict == "cause_found":
        held = _replayed(asked.diagnosed, answer)
        if held and held.confirmation.verdict == "confirmed" and not held.confirmation.cautions:
            return Judged(_unasked(asked.diagnosed), "question", refused, held)
    if refused is None:
        return Judged(alone, "answer", None, None)
    suspected = tuple(cause.name for cause in named.causes)
    unexplained = replace(named, verdict="unexplained", causes=(), suspected=suspected, other_motion=None)
    return Judged(replace(alone, diagnosis=unexplained), "answer", named, replay)


def _replayed(diagnosed: Diagnosed, recording: Recording) -> Replay | None:
    """Replay of a model; None where that is not possible, as without a column that the model follows."""
    try:
        return confirm(diagnosed, recording)
    except RecordingError:
        return None


def _unasked(diagnosed: Diagnosed) -> Diagnosed:
    """Copy without the motion to record next, unless that is one in words: then unchanged."""
    motion = diagnosed.diagnosis.next_motion
    if motion is None or motion.words is not None:
        return diagnosed
    return replace(diagnosed, diagnosis=replace(diagnosed.diagnosis, next_motion=None))
