from itertools import pairwise
from math import cos, pi, sin, tan
from random import Random

import numpy as np
import pytest

from forefeel.common.estimation.state_filter import StateFilter

CUTOFF_HZ = 20.0
W = 2.0 * pi * CUTOFF_HZ


def butterworth(s: complex) -> complex:
    return W**3 / (s**3 + 2.0 * W * s**2 + 2.0 * W**2 * s + W**3)


def phasors(frequency_hz: float, dt: float) -> list[complex]:
    """Complex gains of (x_f, v_f, a_f) for a sinusoid, by correlation over whole periods after settling."""
    state, w = StateFilter(CUTOFF_HZ), 2.0 * pi * frequency_hz
    count = round(1.0 / (frequency_hz * dt)) * 5
    outputs = np.array([state.step(sin(w * i * dt), dt) for i in range(3 * count)])[2 * count :]
    t = np.arange(2 * count, 3 * count) * dt
    return [complex(2j * np.mean(outputs[:, k] * np.exp(-1j * w * t))) for k in range(3)]


@pytest.mark.parametrize("frequency_hz", [1.0, 20.0, 40.0])
def test_gain_and_phase_are_those_of_the_butterworth_filter_under_tustin(frequency_hz: float) -> None:
    dt = 0.001
    s = 1j * 2.0 / dt * tan(pi * frequency_hz * dt)
    expected = [butterworth(s), s * butterworth(s), s * s * butterworth(s)]
    assert phasors(frequency_hz, dt) == pytest.approx(expected, rel=1e-6)


def trapezoidal_motion(rng: Random, count: int) -> list[tuple[float, float, float, float]]:
    """(dt, x, v, a) related by the trapezoidal rule, from rest, dt irregular by a factor of 20."""
    x, v, a, rows = 0.01, 0.0, 0.0, [(0.001, 0.01, 0.0, 0.0)]
    for i in range(1, count):
        dt = rng.uniform(0.0002, 0.004)
        a_next = sin(0.02 * i) + rng.gauss(0.0, 0.5)
        v_next = v + 0.5 * dt * (a + a_next)
        x, v, a = x + 0.5 * dt * (v + v_next), v_next, a_next
        rows.append((dt, x, v, a))
    return rows


def test_matched_filters_keep_a_linear_relation_exact_at_irregular_stamps() -> None:
    m, b, k, bias = 0.05, 0.6, 80.0, 0.3
    motion, force = StateFilter(CUTOFF_HZ), StateFilter(CUTOFF_HZ)
    for dt, x, v, a in trapezoidal_motion(Random(1), 2000):
        x_f, v_f, a_f = motion.step(x, dt)
        f_f, _, _ = force.step(m * a + b * v + k * x + bias, dt)
        assert f_f == pytest.approx(m * a_f + b * v_f + k * x_f + bias, abs=1e-11)


def test_irregular_sampling_gives_the_continuous_filter_too() -> None:
    rng, w = Random(2), 2.0 * pi * 2.0
    stamps = [0.0]
    while stamps[-1] < 2.0:
        stamps.append(stamps[-1] + rng.uniform(0.0003, 0.0017))
    state, gain = StateFilter(CUTOFF_HZ), butterworth(1j * w)
    state.step(1.0, 0.001)
    for before, t in pairwise(stamps):
        x, v, a = state.step(cos(w * t), t - before)
    turn = gain * np.exp(1j * w * stamps[-1])
    assert (x, v / w, a / w**2) == pytest.approx((turn.real, -turn.imag, -turn.real), abs=2e-4)


def test_it_starts_at_rest_at_its_first_value_and_again_after_reset() -> None:
    state = StateFilter(CUTOFF_HZ)
    assert state.step(0.2, 0.001) == (0.2, 0.0, 0.0)
    assert state.step(0.2, 0.05) == (0.2, 0.0, 0.0)
    state.step(0.3, 0.001)
    state.reset()
    assert state.step(-1.0, 0.001) == (-1.0, 0.0, 0.0)
