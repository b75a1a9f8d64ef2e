"""A controller's force is told from the force of a contact."""

import numpy as np
import pytest

from forefeel.common.causes.candidate import Model
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.closed_loop import feeds_the_motion
from forefeel.diagnosis.sensor_faults import clean
from tests.hidden_effects.generator import VOCABULARY, draw

RICHER: Model = {"bias": (), "coulomb_friction": (), "stiffening": (), "quadratic_drag": ()}
FINE_HZ, RATE_HZ = 8000.0, 500.0


def _feeds(recording: Recording, model: Model) -> bool:
    cleaned = clean(recording)
    regression = conditioned(recording, cleaned)
    return feeds_the_motion(recording, cleaned.force_n, regression, regression.fit(model))


def _held_in_place(seconds: float) -> Recording:
    """A spring and damper by control follow a slow reference against a disturbance that is not measured."""
    rng, count = np.random.default_rng(4), int(seconds * FINE_HZ)
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    lines = int(12.0 * seconds)
    spectrum[1:lines] = np.exp(2j * np.pi * rng.random(lines - 1))
    disturbance_n = np.fft.irfft(spectrum, count)
    disturbance_n *= 0.03 / np.std(disturbance_n)
    slow = 2.0 * np.pi * np.arange(count) / FINE_HZ
    reference = 4e-3 * np.sin(0.31 * slow) + 2e-3 * np.sin(0.83 * slow + 1.0)
    gain, rate = 60.0, 2.0
    x = _moved(gain * reference + disturbance_n, 0.08, 0.7 + rate, 30.0 + gain)
    force = gain * (reference - x) - rate * np.gradient(x) * FINE_HZ
    every = round(FINE_HZ / RATE_HZ)
    seen, f = x[::every], force[::every]
    noisy = f + 2e-3 * rng.standard_normal(len(f))
    return Recording(
        "held", np.arange(len(seen)) / RATE_HZ, seen + 1e-6 * rng.standard_normal(len(f)), noisy, "test"
    )


def _moved(force_n: Floats, mass: float, damping: float, stiffness: float) -> Floats:
    """Position after each fine step, semi-implicit Euler."""
    x = v = 0.0
    out = np.empty(len(force_n))
    for i, f in enumerate(force_n.tolist()):
        v = (v + (f - stiffness * x) / mass / FINE_HZ) / (1.0 + damping / mass / FINE_HZ)
        x += v / FINE_HZ
        out[i] = x
    return out


@pytest.mark.parametrize(("seconds", "seen"), [(20.0, True), (1.0, False)])
def test_controller_that_holds_a_place_is_seen(seconds: float, seen: bool) -> None:
    assert _feeds(_held_in_place(seconds), RICHER) == seen


@pytest.mark.parametrize("kind", ["nothing", *VOCABULARY[::3]])
def test_imposed_motion_is_not_fed(kind: str) -> None:
    hidden = draw(kind, 1000, longest_s=15.0, fastest_hz=400.0)
    model = dict(RICHER)
    for name, key in (("time_delay", "delay_s"), ("sensor_lag", "time_constant_s")):
        if name in hidden.truth.parameters:
            model[name] = (hidden.truth.parameters[name][key],)
    if "fixture" in hidden.truth.labels:
        values = hidden.truth.parameters["unmodelled_resonance"]
        model["unmodelled_resonance:fixture"] = (values["frequency_hz"], values["damping_ratio"])
    recording = Recording("hidden", hidden.time_s, hidden.position_m, hidden.force_n, "test")
    assert not _feeds(recording, model), hidden.truth.motion
