"""The diagnosis of a motion that was asked for, held against the recording that left the question open.

The answer is diagnosed alone: together with the question no more is named, and drift, pulsation and hum can
not be. Both are diagnosed as one only where the force limit cut the answer and it names nothing. A model that
is named has to hold on the question, which no fit has seen: of the models that do not, most are wrong.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from types import MappingProxyType

import numpy as np

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import Progress, conditioned
from forefeel.diagnosis.confirmation import Replay, confirm
from forefeel.diagnosis.diagnose import Diagnosed, check, diagnose
from forefeel.diagnosis.excitation import SECONDS, Limits, excitation
from forefeel.diagnosis.forecast import Forecast, Rivals
from forefeel.diagnosis.sensor_faults import clean
from forefeel.diagnosis.verdict import Diagnosis

_SHARES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1, 0.05)  # of the limits, of which the largest is taken that does
_CUT = 0.8  # of the range that was asked for: an answer that has less was cut


@dataclass(frozen=True, slots=True, eq=False)
class Investigation:
    """A question, and the motion that is asked for.

    Attributes:
        question: the recording that left it open.
        diagnosed: its diagnosis; None where its force is flat or no stretch of it is long enough.
        limits: that `motion`, without a force, stays within.
        forecasts: what each rival of the diagnosis says of the motion.
        reduced: the force limit leaves less of the other limits than they allow.
    """

    question: Recording
    diagnosed: Diagnosed | None
    limits: Limits
    motion: Recording
    forecasts: tuple[Forecast, ...]
    reduced: bool


def investigate(
    question: Recording | Diagnosed,
    limits: Mapping[str, float] = MappingProxyType({}),
    duration_s: float = SECONDS[1],
    progress: Progress = lambda stage: None,
) -> Investigation:
    """Diagnoses a recording, unless it is diagnosed, and makes the motion to record next, within what it has
    reached, and where a rival says that the force stays within its limit. `limits`: fields of `Limits`, in
    place of those reached; with any of them the force has a limit only where it is given.

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
    return Investigation(question, diagnosed, within, motion, tuple(foretold), share < 1.0)


def _unless_flat(question: Recording, progress: Progress) -> Diagnosed | None:
    try:
        return diagnose(question, progress)
    except RecordingError:  # a force that is flat leaves all the more open
        return None


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Verdict on an answer.

    Attributes:
        diagnosed: of the answer, or of question and answer `together`; `unexplained` where its model was not
            confirmed.
        refused: the diagnosis of the answer before that; None where it stands.
        replay: its model on the question; None where none was named, or `together`.
        together: question and answer were diagnosed as one.
    """

    diagnosed: Diagnosed
    refused: Diagnosis | None
    replay: Replay | None
    together: bool = False

    @property
    def named(self) -> Diagnosis:
        """The diagnosis that `replay` was made of."""
        return self.refused or self.diagnosed.diagnosis


def judge(asked: Investigation, answer: Recording, progress: Progress = lambda stage: None) -> Judged:
    """Diagnoses an answer, and confirms its model on the question; asks for no motion a second time.

    Raises:
        RecordingError: the answer can not be diagnosed, or the question has too low a rate for its band.
    """
    alone = _unasked(diagnose(answer, progress))
    if not alone.diagnosis.names_causes:
        # by the force limit: it left less of the range than the bench has, or the motion
        cut = asked.reduced or np.ptp(answer.position_m) < _CUT * np.ptp(asked.motion.position_m)
        both = _together(asked.question, answer, progress) if cut else None
        return Judged(alone if both is None else both, None, None, together=both is not None)
    progress("confirmation")
    replay = confirm(alone, asked.question)
    if replay.confirmation.verdict != "not_confirmed":
        return Judged(alone, None, replay)
    named = alone.diagnosis
    suspected = tuple(cause.name for cause in named.causes)
    unexplained = replace(named, verdict="unexplained", causes=(), suspected=suspected, other_motion=None)
    return Judged(replace(alone, diagnosis=unexplained), named, replay)


def _unasked(diagnosed: Diagnosed) -> Diagnosed:
    """The diagnosis without a motion to record next, if that is the one that was asked for."""
    motion = diagnosed.diagnosis.next_motion
    if motion is None or motion.words is not None:
        return diagnosed
    return replace(diagnosed, diagnosis=replace(diagnosed.diagnosis, next_motion=None))


def _together(question: Recording, answer: Recording, progress: Progress) -> Diagnosed | None:
    """Diagnosis of both as one; None where that names nothing, or can not be made: of two rates, or flat."""
    try:
        both = diagnose(question, progress, beside=[answer])
    except RecordingError:
        return None
    return _unasked(both) if both.diagnosis.names_causes else None
