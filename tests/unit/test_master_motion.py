from math import exp, pi, sqrt
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.devices.simulated.operator import Arm, MinimumJerk, Tremor

METRE = st.floats(-0.5, 0.5)
DURATION = st.floats(0.05, 60.0)


@given(METRE, METRE, DURATION)
def test_a_reach_begins_and_ends_at_rest_where_it_is_told(
    start_m: float, end_m: float, duration_s: float
) -> None:
    reach = MinimumJerk(start_m, end_m, duration_s)
    assert reach.at(0.0) == (start_m, 0.0)
    assert reach.at(-1.0) == (start_m, 0.0)
    position_m, velocity_m_s = reach.at(duration_s)
    assert position_m == pytest.approx(end_m, abs=1e-12)
    assert velocity_m_s == 0.0
    assert reach.at(duration_s + 5.0) == (position_m, velocity_m_s)
    middle_m, peak_m_s = reach.at(duration_s / 2)
    assert middle_m == pytest.approx((start_m + end_m) / 2, abs=1e-12)
    assert peak_m_s == pytest.approx(1.875 * (end_m - start_m) / duration_s, rel=1e-12)


@given(METRE, METRE, DURATION, st.floats(0.0, 1.0))
def test_no_instant_is_faster_than_the_middle_nor_goes_back(
    start_m: float, end_m: float, duration_s: float, share: float
) -> None:
    velocity_m_s = MinimumJerk(start_m, end_m, duration_s).at(share * duration_s)[1]
    length_m = end_m - start_m
    assert abs(velocity_m_s) <= 1.875 * abs(length_m) / duration_s * (1 + 1e-12)
    assert velocity_m_s * length_m >= 0.0


def test_velocity_is_the_derivative_of_position_and_acceleration_vanishes_at_both_ends() -> None:
    reach, h = MinimumJerk(0.01, 0.05, 1.3), 1e-5
    for t in np.linspace(0.05, 1.25, 40):
        difference = (reach.at(t + h)[0] - reach.at(t - h)[0]) / (2 * h)
        assert reach.at(t)[1] == pytest.approx(difference, rel=1e-6)
    for end_s in (h, 1.3 - h):
        acceleration = (reach.at(end_s + h)[1] - reach.at(end_s - h)[1]) / (2 * h)
        assert abs(acceleration) < 1e-4


@pytest.mark.parametrize("seed", range(5))
def test_tremor_is_between_6_and_12_hz_and_within_its_amplitude(seed: int) -> None:
    tremor, rate_hz, seconds = Tremor(2e-4, Random(seed)), 200.0, 40.0
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    x = np.array([tremor.at(s)[0] for s in t])
    assert np.abs(x).max() <= 2e-4
    power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    hz = np.fft.rfftfreq(len(x), 1.0 / rate_hz)
    band = (hz > 5.8) & (hz < 12.2)
    assert power[band].sum() > 0.999 * power.sum()
    assert np.sqrt(np.mean(x**2)) == pytest.approx(sqrt(3 / 2) * 2e-4 / 3, rel=0.1)


def test_tremor_has_its_derivative_and_its_seed() -> None:
    tremor, h = Tremor(2e-4, Random(1)), 1e-6
    for t in (0.0, 0.31, 7.7):
        difference = (tremor.at(t + h)[0] - tremor.at(t - h)[0]) / (2 * h)
        assert tremor.at(t)[1] == pytest.approx(difference, rel=1e-4)
    assert tremor.at(3.3) == Tremor(2e-4, Random(1)).at(3.3)
    assert tremor.at(3.3) != Tremor(2e-4, Random(2)).at(3.3)
    assert Tremor(0.0, Random(1)).at(1.0) == (0.0, 0.0)


def moved(
    arm: Arm, seconds: float, force_n: float, reference_m: float = 0.0, dt_s: float = 1e-3
) -> list[float]:
    positions = list[float]()
    for _ in range(round(seconds / dt_s)):
        arm.advance(reference_m, 0.0, force_n, dt_s)
        positions.append(arm.position_m)
    return positions


@pytest.mark.parametrize("force_n", [0.0, 1.0, -2.5])
def test_a_steady_force_deflects_the_arm_by_force_over_stiffness(force_n: float) -> None:
    arm = Arm(0.4, 12.0, 250.0)
    arm.place(0.02)
    moved(arm, 3.0, force_n, reference_m=0.02)
    assert arm.position_m == pytest.approx(0.02 - force_n / 250.0, abs=1e-9)
    assert arm.velocity_m_s == pytest.approx(0.0, abs=1e-9)


def test_the_arm_answers_a_step_as_the_analytic_oscillator_does() -> None:
    mass, damping, stiffness = 0.4, 12.0, 250.0
    arm = Arm(mass, damping, stiffness)
    positions = moved(arm, 1.0, 1.0)
    decay, omega = damping / (2 * mass), sqrt(stiffness / mass - (damping / (2 * mass)) ** 2)
    t = np.arange(1, 1001) * 1e-3
    shape = np.cos(omega * t) + decay / omega * np.sin(omega * t)
    expected = -1.0 / stiffness * (1.0 - np.exp(-decay * t) * shape)
    np.testing.assert_allclose(positions, expected, atol=0.01 / stiffness)
    assert exp(-decay * 1.0) < 1e-6 and pi / omega < 1.0


@pytest.mark.parametrize("dt_s", [1e-4, 0.8e-3, 5e-3, 50e-3])
def test_the_arm_does_not_depend_on_how_its_time_is_cut(dt_s: float) -> None:
    arm, fine = Arm(0.4, 12.0, 250.0), Arm(0.4, 12.0, 250.0)
    moved(arm, 0.2, 1.0, reference_m=0.01, dt_s=dt_s)
    moved(fine, 0.2, 1.0, reference_m=0.01, dt_s=0.5e-3)
    assert arm.position_m == pytest.approx(fine.position_m, abs=3e-5)
