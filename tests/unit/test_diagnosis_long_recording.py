"""Long recordings are diagnosed by stretches of them; what is local or rare is not lost."""

import numpy as np
import pytest
from scipy.signal import lfilter

from forefeel.common.error_size import Floats
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.long_recording import FLAG, Whole, chunks_of, cleaned_everywhere, is_long
from forefeel.diagnosis.signals import cutoff_hz

RATE_HZ = 250.0
SECONDS = 180.0


def strokes(seed: int, seconds: float = SECONDS) -> tuple[Floats, Floats, Floats, Floats]:
    """t, x, v, a of minimum-jerk strokes with dwells, and a noise-free linear force."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    x, now, at = np.zeros_like(t), 0.2, 0.0
    while now < seconds:
        target, took = rng.uniform(0.0, 0.02), rng.uniform(0.3, 1.6)
        first, last = np.searchsorted(t, (now, now + took))
        s = (t[first:last] - now) / took
        x[first:last] = at + (target - at) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        x[last:] = at = target
        now += took + (rng.uniform(0.1, 0.8) if rng.random() < 0.3 else 0.0)
    v = np.gradient(x, t)
    a = np.gradient(v, t)
    noise = lfilter([1.0], [1.0, -0.6], rng.standard_normal(len(t)))
    return t, x, v, np.asarray(0.03 * a + 0.8 * v + 25.0 * x + 2e-3 * noise / np.std(noise))


def recording(t: Floats, x: Floats, force: Floats, start_s: float = 0.0) -> Recording:
    return Recording("long", t + start_s, np.round(x * 1e6) / 1e6, force, "test")


def test_a_cause_is_named_and_its_interval_is_that_of_the_whole() -> None:
    t = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    w, size = 2.0 * np.pi * np.array([0.13, 0.37, 0.9, 2.3, 5.1]), np.array([6e-3, 5e-3, 2e-3, 1e-3, 2e-4])
    phase = np.outer(t, w) + np.array([0.0, 0.3, 2.0, 4.0, 1.0])
    x, v = np.sin(phase) @ size, np.cos(phase) @ (size * w)
    noise = 2e-3 * np.random.default_rng(1).standard_normal(len(t))
    whole = recording(t, x, 0.8 * v + 25.0 * x + 0.06 * np.tanh(v / 1e-4) + noise)
    assert is_long(whole)
    found = diagnose(whole).diagnosis
    (cause,) = found.causes
    assert cause.name == "coulomb_friction"
    level = cause.parameters["force_n"]
    assert level.value == pytest.approx(0.06, rel=0.02)
    assert level.low < 0.06 < level.high
    assert found.flags == (FLAG,)
    assert found.held_out.gain_low > 0.8


def test_chunks_hold_every_sample_once_and_no_gap() -> None:
    t, x, _, force = strokes(5, 100.0)
    keep = (t < 30.0) | (t > 33.0)
    gapped = recording(t[keep], x[keep], force[keep])
    chunks = chunks_of(gapped, 10.0)
    rows = np.concatenate([np.arange(c.start, c.stop) for c in chunks])
    assert np.array_equal(rows, np.arange(len(gapped)))
    assert all(np.max(np.diff(gapped.time_s[c])) < 0.1 for c in chunks)
    assert all(8.0 < gapped.time_s[c.stop - 1] - gapped.time_s[c.start] < 12.0 for c in chunks)


def test_rare_spikes_are_counted_over_the_whole() -> None:
    t, x, _, force = strokes(6)
    at = np.random.default_rng(6).choice(len(t), 12, replace=False)
    spiky = force.copy()
    spiky[at] += 1.0
    whole = recording(t, x, spiky)
    cleaned, _, faults = cleaned_everywhere(whole, chunks_of(whole, 300.0))
    assert [fault.name for fault in faults] == ["sensor_spikes"]
    assert faults[0].parameters["rate_hz"].value == pytest.approx(12 / SECONDS, rel=0.2)
    assert np.max(np.abs(np.asarray(cleaned.force_n) - force)) < 0.05
    assert "sensor_spikes" in [cause.name for cause in diagnose(whole).diagnosis.causes]


@pytest.mark.parametrize("spikes", [0, 12])
def test_array_of_the_caller_stays_writeable(spikes: int) -> None:
    t, x, _, force = strokes(6, 60.0)
    force[np.random.default_rng(6).choice(len(t), spikes, replace=False)] += 1.0
    force.flags.writeable = False  # a recording then does not copy it
    whole = recording(t, x, force)
    force.flags.writeable = True
    cleaned, _, _ = cleaned_everywhere(whole, chunks_of(whole, 300.0))
    assert force.flags.writeable
    assert np.array_equal(np.asarray(cleaned.force_n), force) == (spikes == 0)


def test_recording_of_bursts_below_three_seconds_is_refused() -> None:
    t, x, _, force = strokes(7, 60.0)
    whole = recording(t, x, force)
    searched = Whole(whole, np.zeros(len(t), dtype=np.bool_), [], lambda stage: None, [], ())
    with pytest.raises(RecordingError, match=r"^test: no piece without gaps lasts 3 s[^\n]*$"):
        searched.searched()


def test_slow_recording_of_minutes_is_decimated_and_searched_whole() -> None:
    t = np.arange(int(400.0 * 60.0)) / 60.0
    slow = recording(t, 5e-3 * np.sin(2.0 * np.pi * 1.3 * t), 0.3 * np.sin(2.0 * np.pi * 1.3 * t))
    assert not is_long(slow)
    assert slow.force_n is not None
    assert cutoff_hz(slow, slow.force_n) == pytest.approx(9_000 / (2.0 * 400.0), rel=1e-3)
    fast = recording(t, slow.position_m, slow.force_n + 0.05 * np.sin(2.0 * np.pi * 9.0 * t))
    assert is_long(fast)
