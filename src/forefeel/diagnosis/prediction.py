"""The gain where it counts: the force predicted across a delay, with the extended model and without."""

from dataclasses import dataclass

import numpy as np

from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import rms
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import prepare
from forefeel.diagnosis.evaluation.methods import METHODS, MethodTrace, replay
from forefeel.diagnosis.evaluation.score import completed
from forefeel.diagnosis.long_recording import liveliest

DELAY_S = 0.3
_LONGEST = 20_000  # samples that are replayed


@dataclass(frozen=True, slots=True)
class Across:
    """rms errors in N across `delay_s`: of zoh, of the master without a model, and with the extended one.

    `from_s`, `to_s`: the stretch that was replayed, since the first stamp of the recording.
    """

    delay_s: float
    zoh_n: float
    before_n: float
    after_n: float
    from_s: float
    to_s: float


def across_delay(recording: Recording, extended: ContactModel) -> Across:
    """Replays a recording, of a longer one the 20,000 samples in which it travels farthest, with the force
    0.3 s late; returns rms errors of zoh, and of forefeel's predictor without a model and with `extended`.

    They count from the first force that arrives on: a model is loaded for the first strokes.

    Raises:
        RecordingError: no force, or too short for a prediction across the delay.
    """
    start_s = recording.time_s[0]
    if len(recording) > _LONGEST:
        recording = recording.cut(liveliest(recording, _LONGEST / recording.rate_hz))
    prepared = prepare(recording, DelayedLink(DELAY_S, 0.0, 0.0, 0))
    before, after = (
        replay(recording, prepared.arrivals, METHODS["forefeel"](model)) for model in (None, extended)
    )

    def error_n(trace: MethodTrace) -> float:
        return rms(np.asarray((completed(trace, prepared.zoh) - prepared.force_n)[prepared.zoh.answered]))

    from_s, to_s = (recording.time_s[[0, -1]] - start_s).tolist()
    return Across(DELAY_S, error_n(prepared.zoh), error_n(before), error_n(after), from_s, to_s)
