"""The gain where it counts: the force predicted across a delay, with the extended model and without."""

from dataclasses import dataclass

import numpy as np

from forefeel.common.causes.candidate import entry
from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.causes.sensor import Bias
from forefeel.common.causes.wall import MassDamperSpring
from forefeel.common.error_size import rms
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import prepare
from forefeel.diagnosis.evaluation.methods import METHODS, MethodTrace, replay
from forefeel.diagnosis.evaluation.score import completed
from forefeel.diagnosis.long_recording import cut
from forefeel.diagnosis.regression import BASE

DELAY_S = 0.3
_LONGEST = 20_000  # samples that are replayed
_LINEAR = ContactModel.from_mapping(
    {
        "schema": SCHEMA,
        "name": "m, b, k and bias",
        "effects": [entry(MassDamperSpring, dict.fromkeys(BASE, 0.0)), entry(Bias, {"force_n": 0.0})],
    }
)


@dataclass(frozen=True, slots=True)
class Across:
    """rms errors in N across `delay_s`: of zoh, of forefeel with m, b, k and bias, and extended."""

    delay_s: float
    zoh_n: float
    before_n: float
    after_n: float


def across_delay(recording: Recording, extended: ContactModel) -> Across:
    """Replays the recording as `forefeel evaluate` does; of long ones the first 20,000 samples.

    Raises:
        RecordingError: too short for a prediction across the delay.
    """
    if len(recording) > _LONGEST:
        recording = cut(recording, slice(0, _LONGEST))
    prepared = prepare(recording, DelayedLink(DELAY_S, 0.0, 0.0, 0))
    before, after = (
        replay(recording, prepared.arrivals, METHODS["forefeel"](model)) for model in (_LINEAR, extended)
    )

    def error_n(trace: MethodTrace) -> float:
        return rms(np.asarray((completed(trace, prepared.zoh) - prepared.force_n)[prepared.rows]))

    return Across(DELAY_S, error_n(prepared.zoh), error_n(before), error_n(after))
