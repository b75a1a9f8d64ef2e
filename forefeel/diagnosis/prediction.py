"""The gain where it counts: the force predicted across a delay, with the extended model and without."""

from dataclasses import dataclass

import numpy as np

from forefeel.common.causes.candidate import entry
from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.causes.sensor import Bias
from forefeel.common.causes.wall import MassDamperSpring
from forefeel.common.error_size import Floats, rms
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import prepare
from forefeel.diagnosis.evaluation.methods import METHODS, MethodTrace, replay
from forefeel.diagnosis.evaluation.score import completed
from forefeel.diagnosis.long_recording import cut
from forefeel.diagnosis.regression import BASE

DELAY_S = 0.3
_EARLY_S = 10.0
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
    """rms errors in N across `delay_s`: of zoh, of forefeel with m, b, k and bias, and extended.

    `early_n`, `late_n`: (before, after) in the first `early_s` that are scored, and from then on; None where
    nothing is left. `contact_share`: of the time in which the extended contact model led the prediction: it
    is all that a model.yaml changes, beside experts that learn from the late forces alone.
    """

    delay_s: float
    zoh_n: float
    before_n: float
    after_n: float
    early_s: float
    early_n: tuple[float, float]
    late_n: tuple[float, float] | None
    contact_share: float


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
    stamps_s = recording.time_s[prepared.rows]
    late = stamps_s >= stamps_s[0] + _EARLY_S

    def errors(trace: MethodTrace) -> Floats:
        return np.asarray((completed(trace, prepared.zoh) - prepared.force_n)[prepared.rows])

    hold, plain, new = map(errors, (prepared.zoh, before, after))
    leading = np.array([each.startswith("contact") for each in after.leading])
    return Across(
        DELAY_S,
        rms(hold),
        rms(plain),
        rms(new),
        _EARLY_S,
        (rms(plain[~late]), rms(new[~late])),
        (rms(plain[late]), rms(new[late])) if late.any() else None,
        float(np.mean(leading[prepared.rows])),
    )
