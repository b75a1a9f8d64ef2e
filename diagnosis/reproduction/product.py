"""The product's identification and prediction replayed on a recording, at its own stamps.

The same `ContactIdentifier` and `ContactPredictor` that run in the master, fed as a master that is `delay_s`
away would be. The scales of the regressors come from the recording's stroke and force, as in
`forefeel loopback --recording`.
"""

import numpy as np

from common.effects.model import ContactModel
from common.estimation.identification import ContactEstimate, ContactIdentifier, IdentificationSettings
from common.estimation.prediction import ContactPredictor
from common.recording.recording import GAP_S, Recording
from diagnosis.reproduction.contact import Array
from diagnosis.reproduction.online import held, newest_index

_CUTOFF_HZ, _VELOCITY_CUTOFF_HZ = 15.0, 40.0
_ESTIMATE_EVERY_S = 0.05


def product_prediction(recording: Recording, model: ContactModel, delay_s: float) -> Array:
    """The force predicted for each sample, shape (n,); the held one until the identification is valid.

    A contact must resist in the recording: the model's bounds say so.
    """
    assert recording.force_n is not None
    time_s, rate_hz = recording.time_s, recording.rate_hz
    stamps_ns = np.rint((time_s - time_s[0]) * 1e9).astype(np.int64).tolist()
    position_m, force_n = recording.position_m.tolist(), recording.force_n.tolist()
    identifier = ContactIdentifier(model, _settings(recording))
    predictor = ContactPredictor(model, min(_VELOCITY_CUTOFF_HZ, rate_hz / 4.0))
    velocity_m_s = _velocity(recording)
    predicted = held(time_s, recording.force_n, delay_s)
    estimate: ContactEstimate | None = None
    next_force, refresh_ns = 0, 0
    for i, available in enumerate(newest_index(time_s, delay_s).tolist()):
        for j in range(next_force, available + 1):
            identifier.observe(stamps_ns[j], position_m[j], force_n[j])
        next_force = max(next_force, available + 1)
        if next_force and stamps_ns[i] >= refresh_ns:
            estimate = identifier.estimate()
            refresh_ns = stamps_ns[i] + round(_ESTIMATE_EVERY_S * 1e9)
        value = predictor.predict(stamps_ns[i], position_m[i], velocity_m_s[i], estimate)
        if value is not None:
            predicted[i] = value
    return predicted


def _settings(recording: Recording) -> IdentificationSettings:
    assert recording.force_n is not None
    return IdentificationSettings(
        cutoff_hz=min(_CUTOFF_HZ, recording.rate_hz / 4.0),
        min_updates=round(recording.rate_hz),
        noise_floor_n=max(0.01 * float(np.std(recording.force_n)), 1e-6),
        nominal_amplitude_m=max(0.5 * float(np.ptp(recording.position_m)), 1e-9),
    )


def _velocity(recording: Recording) -> list[float]:
    """Backward differences, 0 behind a gap."""
    steps_s = np.diff(recording.time_s)
    velocity = np.diff(recording.position_m) / steps_s
    return [0.0, *np.where(steps_s > GAP_S, 0.0, velocity).tolist()]
