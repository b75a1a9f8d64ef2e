"""Effects that a first model lacks, against closed forms."""

from itertools import pairwise
from math import cos, e, exp, pi, sin, sqrt

import numpy as np
import pytest

from forefeel.common.causes.damping import AsymmetricDamping, HuntCrossleyDamping, QuadraticDrag
from forefeel.common.causes.friction import CoulombFriction, PreslidingHysteresis, StribeckFriction
from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.numerics import Array
from forefeel.common.causes.periodic import MainsHum, Pulsation
from forefeel.common.causes.sensor import SensorLag, SensorSpikes, TimeDelay
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance
from forefeel.common.causes.wall import ExponentialWall, Stiffening, StiffnessChange

DT = 1e-3


def stamps(count: int, dt: float = DT) -> Array:
    return np.arange(count, dtype=np.float64) * dt


def test_stribeck_friction_falls_from_static_to_kinetic() -> None:
    effect = StribeckFriction(coulomb_n=0.1, static_n=0.3, stribeck_velocity_m_s=0.01)
    at = {v: effect.step(0.0, 0.0, v, 0.0, DT) for v in (1e-4, 0.01, -0.01, 0.1, 0.0)}
    assert at[1e-4] == pytest.approx(0.3, rel=1e-3)
    assert at[0.01] == pytest.approx(0.1 + 0.2 / e)
    assert at[-0.01] == -at[0.01]
    assert at[0.1] == pytest.approx(0.1)
    assert at[0.0] == 0.0


@pytest.mark.parametrize("v", [-0.3, -0.004, 0.0, 3e-6, 0.02])
def test_stribeck_friction_of_equal_levels_is_coulomb_friction(v: float) -> None:
    stribeck = StribeckFriction(coulomb_n=0.2, static_n=0.2, stribeck_velocity_m_s=0.004)
    coulomb = CoulombFriction(force_n=0.2)
    assert stribeck.step(0.0, 0.0, v, 0.0, DT) == pytest.approx(coulomb.step(0.0, 0.0, v, 0.0, DT))


def test_hunt_crossley_damping_needs_depth_and_speed() -> None:
    effect = HuntCrossleyDamping(damping_n_s_m2=40.0)
    assert effect.step(0.0, 0.02, 0.05, 0.0, DT) == pytest.approx(40.0 * 0.02 * 0.05)
    assert effect.step(0.0, 0.02, -0.05, 0.0, DT) == pytest.approx(-40.0 * 0.02 * 0.05)
    assert effect.step(0.0, -0.02, 0.05, 0.0, DT) == 0.0


def test_quadratic_drag_opposes_the_motion() -> None:
    effect = QuadraticDrag(drag_n_s2_m2=30.0)
    assert effect.step(0.0, 0.0, 0.2, 0.0, DT) == pytest.approx(30.0 * 0.04)
    assert effect.step(0.0, 0.0, -0.2, 0.0, DT) == pytest.approx(-30.0 * 0.04)


def test_asymmetric_damping_has_a_coefficient_for_each_direction() -> None:
    effect = AsymmetricDamping(forward_n_s_m=2.0, backward_n_s_m=0.5)
    assert effect.step(0.0, 0.0, 0.1, 0.0, DT) == pytest.approx(0.2)
    assert effect.step(0.0, 0.0, -0.1, 0.0, DT) == pytest.approx(-0.05)


def test_exponential_wall_is_fungs_law_without_its_linear_part() -> None:
    effect = ExponentialWall(exponential_n=0.05, length_m=0.004)
    assert effect.step(0.0, 0.01, 0.0, 0.0, DT) == pytest.approx(0.05 * (exp(2.5) - 1 - 2.5))
    assert effect.step(0.0, -0.01, 0.0, 0.0, DT) == pytest.approx(0.05 * (exp(-2.5) - 1 + 2.5))
    shallow = 1e-5
    square, cube = 0.05 / (2 * 0.004**2), 0.05 / (6 * 0.004**3)
    polynomial = Stiffening(quadratic_n_m2=square, cubic_n_m3=cube)
    assert effect.step(0.0, shallow, 0.0, 0.0, DT) == pytest.approx(
        polynomial.step(0.0, shallow, 0.0, 0.0, DT), rel=1e-6
    )


def test_exponential_wall_does_not_overflow() -> None:
    assert ExponentialWall(exponential_n=1.0, length_m=1e-5).step(0.0, 10.0, 0.0, 0.0, DT) == pytest.approx(
        exp(50.0)
    )


def test_a_changed_stiffness_is_the_ratio_of_the_old_one() -> None:
    wall = {"mass_kg": 0.0, "damping_n_s_m": 0.0, "stiffness_n_m": 8.0}
    change = {"stiffness_n_m": 8.0, "time_s": 2.5, "ratio": 0.25, "rest_position_m": 0.01}
    effects = [
        {"effect": "mass_damper_spring", "parameters": wall},
        {"effect": "bias", "parameters": {"force_n": -8.0 * 0.01}},
        {"effect": "stiffness_change", "parameters": change},
    ]
    model = ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "puncture", "effects": effects})
    runtime = model.runtime()
    assert runtime.step(2.499, 0.03, 0.0, 0.0, DT) == pytest.approx(8.0 * 0.02)
    assert runtime.step(2.5, 0.03, 0.0, 0.0, DT) == pytest.approx(0.25 * 8.0 * 0.02)


def test_the_span_of_a_stiffness_change_leads_back_to_ratio_and_rest() -> None:
    found = StiffnessChange(stiffness_n_m=8.0, time_s=2.5).from_span([-6.0, 0.06])
    assert found == pytest.approx(
        {"stiffness_n_m": 8.0, "time_s": 2.5, "ratio": 0.25, "rest_position_m": 0.01}
    )


@pytest.mark.parametrize("kind", [MainsHum, Pulsation])
def test_a_periodic_force_has_three_harmonics_with_phases_of_their_own(
    kind: type[MainsHum] | type[Pulsation],
) -> None:
    values = {
        "amplitude_n": 0.02,
        "frequency_hz": 49.7,
        "phase_rad": 0.4,
        "second_harmonic_ratio": 0.3,
        "second_harmonic_phase_rad": -1.0,
        "third_harmonic_ratio": 2.0,
        "third_harmonic_phase_rad": 2.0,
    }
    p = 2 * pi * 49.7 * 1.234 + 0.4
    force = 0.02 * (sin(p) + 0.3 * sin(2 * p - 1.0) + 2.0 * sin(3 * p + 2.0))
    assert kind(**values).step(1.234, 0.0, 0.0, 0.0, DT) == pytest.approx(force)


@pytest.mark.parametrize("kind", [MainsHum, Pulsation])
def test_a_linear_fit_at_the_frequency_finds_phases_and_harmonics(
    kind: type[MainsHum] | type[Pulsation],
) -> None:
    values = {
        "amplitude_n": 0.02,
        "frequency_hz": 47.3,
        "phase_rad": -2.1,
        "second_harmonic_ratio": 0.4,
        "second_harmonic_phase_rad": 1.3,
        "third_harmonic_ratio": 0.1,
        "third_harmonic_phase_rad": -0.7,
    }
    t = stamps(2000)
    rest = np.zeros_like(t)
    force = 0.02 * kind(**values).columns(t, rest, rest, rest)[:, 0]
    blank = kind(frequency_hz=47.3)
    found = np.linalg.lstsq(blank.span(t, rest, rest, rest), force, rcond=None)[0]
    assert blank.from_span(found.tolist()) == pytest.approx(values, rel=1e-6)


def test_a_linear_fit_of_dahl_keeps_its_presliding_length() -> None:
    found = PreslidingHysteresis(force_n=1.0, stiffness_n_m=2000.0).from_span([0.08])
    assert found == pytest.approx({"force_n": 0.08, "stiffness_n_m": 160.0})


def test_a_delay_gives_the_force_of_then() -> None:
    effect = TimeDelay(delay_s=0.0255)
    readings = [effect.sense(i * DT, sin(i * DT), DT) for i in range(200)]
    assert readings[:26] == [0.0] * 26
    expected = [sin(i * DT - 0.0255) for i in range(26, 200)]
    assert readings[26:] == pytest.approx(expected, abs=2e-7)
    effect.reset()
    assert effect.sense(0.0, 0.7, DT) == 0.7


def test_no_delay_changes_nothing() -> None:
    effect = TimeDelay(delay_s=0.0)
    assert [effect.sense(i * DT, float(i), DT) for i in range(5)] == [0.0, 1.0, 2.0, 3.0, 4.0]


def spikes(effect: SensorSpikes, duration_s: float, dt: float) -> list[float]:
    return [effect.sense(i * dt, 0.0, dt) for i in range(round(duration_s / dt))]


def test_spikes_come_at_their_rate_and_size_and_alone() -> None:
    found = spikes(SensorSpikes(rate_hz=2.0, amplitude_n=0.4, seed=7), 200.0, DT)
    sizes = [abs(force) for force in found if force]
    assert 340 < len(sizes) < 460  # 400, the standard deviation is 19
    assert all(0.2 <= size <= 0.6 for size in sizes)
    assert sum(sizes) / len(sizes) == pytest.approx(0.4, rel=0.05)
    assert 0.4 < sum(force > 0 for force in found) / len(sizes) < 0.6
    assert sum(a != 0.0 and b != 0.0 for a, b in pairwise(found)) <= 4
    gaps = np.diff(np.flatnonzero(found)) * DT
    assert np.std(gaps) == pytest.approx(0.5, rel=0.2)  # irregular, as of a Poisson process


def test_spikes_are_the_same_at_any_rate_of_steps_and_differ_by_seed() -> None:
    values = {"rate_hz": 3.0, "amplitude_n": 0.4}
    coarse = spikes(SensorSpikes(**values, seed=1), 20.0, 1e-3)
    fine = spikes(SensorSpikes(**values, seed=1), 20.0, 1e-4)
    assert fine[::10] == coarse
    assert spikes(SensorSpikes(**values, seed=2), 20.0, 1e-3) != coarse
    slow = spikes(SensorSpikes(**values, seed=1), 20.0, 0.02)
    assert abs(np.count_nonzero(slow) - np.count_nonzero(coarse)) <= 3  # two may fall into one step


@pytest.mark.parametrize("steps", [1, 7, 400])
def test_a_resonance_rings_as_its_closed_form(steps: int) -> None:
    frequency_hz, damping_ratio, accelerated_s, free_s, a = 8.0, 0.1, 0.05, 0.11, 2.0
    effect = UnmodelledResonance(
        stiffness_n_m=30.0, damping_n_s_m=0.2, frequency_hz=frequency_hz, damping_ratio=damping_ratio
    )
    for _ in range(steps):
        effect.step(0.0, 0.0, 0.0, a, accelerated_s / steps)
    for _ in range(steps):
        force = effect.step(0.0, 0.0, 0.0, 0.0, free_s / steps)
    w = 2 * pi * frequency_hz
    swing, decay = w * sqrt(1 - damping_ratio**2), damping_ratio * w

    def answer(t: float) -> tuple[float, float]:
        """z and z' of the answer to a step of acceleration at 0."""
        lag = 1 - exp(-decay * t) * (cos(swing * t) + decay / swing * sin(swing * t))
        return a / w**2 * lag, a / swing * exp(-decay * t) * sin(swing * t)

    (z1, v1), (z2, v2) = answer(accelerated_s + free_s), answer(free_s)
    assert force == pytest.approx(30.0 * (z1 - z2) + 0.2 * (v1 - v2), rel=1e-9)


def test_a_hanging_mass_far_above_the_motion_is_just_a_mass() -> None:
    w = 2 * pi * 200.0
    effect = UnmodelledResonance(
        stiffness_n_m=0.05 * w**2, damping_n_s_m=2 * 0.5 * w * 0.05, frequency_hz=200.0, damping_ratio=0.5
    )
    t = stamps(20000, 1e-4)
    a = np.sin(2 * pi * 1.0 * t)
    force = [effect.step(0.0, 0.0, 0.0, float(now), 1e-4) for now in a]
    np.testing.assert_allclose(force[5000:], 0.05 * a[5000:], atol=0.05 * 5e-3)


def test_a_resonance_is_tallest_at_its_frequency() -> None:
    def size(frequency_hz: float) -> float:
        t = stamps(4000)
        effect = UnmodelledResonance(stiffness_n_m=1.0, frequency_hz=12.0, damping_ratio=0.05)
        a = np.sin(2 * pi * frequency_hz * t)
        return float(np.std(effect.columns(t, a, a, a)[2000:, 0]))

    assert size(12.0) > 5 * size(8.0)
    assert size(12.0) > 5 * size(18.0)
    assert size(12.0) == pytest.approx(1 / (2 * 0.05 * (2 * pi * 12.0) ** 2) / sqrt(2), rel=0.02)


def test_a_column_of_a_read_only_table_is_taken() -> None:
    t = stamps(50, 1.0)
    table = np.stack((t, t * t), axis=1)
    table.flags.writeable = False
    resonance, lag = UnmodelledResonance(stiffness_n_m=1.0), SensorLag(time_constant_s=0.3)
    a = table[:, 1]
    np.testing.assert_array_equal(resonance.columns(t, t, t, a), resonance.columns(t, t, t, a.copy()))
    np.testing.assert_array_equal(lag.readings(t, a), lag.readings(t, a.copy()))
