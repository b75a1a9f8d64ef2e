"""How large the noise is, told without a model of the contact."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.noise import NoiseFloor, noise_floor

SECONDS, NOISE_N, FRICTION_N = 30.0, 2e-3, 0.08
BAND_HZ = 30.0


def white(count: int, rate_hz: float) -> Floats:
    return np.random.default_rng(1).standard_normal(count)


def pink(count: int, rate_hz: float) -> Floats:
    spectrum = np.fft.rfft(white(count, rate_hz))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0.0
    return np.fft.irfft(spectrum, count)


def first_order(count: int, rate_hz: float) -> Floats:
    decay = np.exp(-2.0 * np.pi * 1.0 / rate_hz)
    return np.asarray(lfilter([1.0], [1.0, -decay], white(count, rate_hz)))


def recorded(noise: Floats, rate_hz: float) -> Recording:
    """Strokes with a tremor against a wall with dry friction, an encoder of 10 um."""
    t = np.arange(len(noise)) / rate_hz
    w, size = 2.0 * np.pi * np.array([0.3, 0.8, 2.1, 5.3]), np.array([0.01, 0.004, 0.001, 1e-4])
    phase = np.outer(t, w) + np.arange(4.0)
    x, v = np.sin(phase) @ size, np.cos(phase) @ (size * w)
    force = 25.0 * x + 0.9 * v + FRICTION_N * np.sign(v) + noise
    return Recording("made", t, np.round(x / 1e-5) * 1e-5, force, "test")


def found(kind: object, rate_hz: float) -> tuple[NoiseFloor | None, float]:
    """The floor, and the true rms up to 30 Hz."""
    noise = kind(int(SECONDS * rate_hz), rate_hz)  # type: ignore[operator]
    noise = NOISE_N * noise / np.std(noise)
    spectrum = np.fft.rfft(noise)
    spectrum[np.fft.rfftfreq(len(noise), 1.0 / rate_hz) > BAND_HZ] = 0.0
    recording = recorded(noise, rate_hz)
    assert recording.force_n is not None
    return noise_floor(recording, recording.force_n), float(np.std(np.fft.irfft(spectrum, len(noise))))


@pytest.mark.parametrize("rate_hz", [200.0, 500.0, 2000.0])
@pytest.mark.parametrize(("kind", "slope"), [(white, 0.0), (pink, 1.0)])
def test_level_and_colour_show_beside_friction_and_tremor(kind: object, slope: float, rate_hz: float) -> None:
    floor, true_n = found(kind, rate_hz)
    assert floor is not None and floor.slope == slope
    assert floor.rms_n(1.0 / SECONDS, BAND_HZ) == pytest.approx(true_n, rel=0.2)


@pytest.mark.parametrize("rate_hz", [500.0, 2000.0])
def test_noise_with_a_corner_is_bounded_from_above(rate_hz: float) -> None:
    floor, true_n = found(first_order, rate_hz)
    assert floor is not None
    assert 0.8 * true_n < floor.rms_n(1.0 / SECONDS, BAND_HZ) < 3.0 * true_n


def test_a_slow_recording_a_filtered_one_and_a_force_that_stands_still_tell_nothing() -> None:
    assert found(white, 40.0)[0] is None
    assert found(white, 7.0)[0] is None  # not one sample in the shortest stretch
    recording = recorded(NOISE_N * white(15000, 500.0), 500.0)
    assert recording.force_n is not None
    filtered = sosfiltfilt(butter(3, 12.0, fs=500.0, output="sos"), recording.force_n)
    assert noise_floor(recording, np.asarray(filtered)) is None
    assert noise_floor(recording, np.where(np.arange(15000) == 7000, 1.0, 0.0)) is None
