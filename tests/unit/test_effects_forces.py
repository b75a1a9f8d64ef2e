"""Force effects against closed forms."""

from math import exp, pi, sin

import pytest

from forefeel.common.causes.base import ForceEffect
from forefeel.common.causes.friction import (
    BAND_M_S,
    CoulombFriction,
    PositionDependentFriction,
    PreslidingHysteresis,
)
from forefeel.common.causes.periodic import Pulsation
from forefeel.common.causes.sensor import Bias, SensorDrift
from forefeel.common.causes.wall import MassDamperSpring, Stiffening, StressRelaxation


def glide(effect: ForceEffect, distance_m: float, speed_m_s: float, steps: int) -> float:
    """The force after moving by `distance_m` at constant speed in so many steps."""
    dt = abs(distance_m / speed_m_s) / steps
    v = speed_m_s if distance_m > 0 else -speed_m_s
    force = 0.0
    for _ in range(steps):
        force = effect.step(0.0, 0.0, v, 0.0, dt)
    return force


def test_mass_damper_spring_is_equation_1_of_the_paper() -> None:
    effect = MassDamperSpring(mass_kg=0.01, damping_n_s_m=0.1, stiffness_n_m=1.0)
    assert effect.step(0.0, 0.3, 0.2, 5.0, 1e-3) == pytest.approx(0.01 * 5.0 + 0.1 * 0.2 + 1.0 * 0.3)


@pytest.mark.parametrize(("v", "expected"), [(0.02, 0.3), (-0.02, -0.1), (0.0, 0.0), (BAND_M_S / 2, 0.15)])
def test_coulomb_friction_opposes_each_direction_with_its_own_level(v: float, expected: float) -> None:
    assert CoulombFriction(forward_n=0.3, backward_n=0.1).step(0.0, 0.0, v, 0.0, 1e-3) == pytest.approx(
        expected
    )


def test_coulomb_friction_takes_one_force_for_both_directions() -> None:
    assert CoulombFriction(force_n=0.2).values == {
        "forward_n": 0.2,
        "backward_n": 0.2,
        "breakaway_m": 0.0,
    }
    with pytest.raises(ValueError, match=r"^coulomb_friction.forward_n: sets forward_n a second time$"):
        CoulombFriction(force_n=0.2, forward_n=0.3)


def test_with_a_breakaway_friction_turns_over_twice_that_distance() -> None:
    effect = CoulombFriction(force_n=0.2, breakaway_m=1e-5)
    assert glide(effect, 5e-6, 1e-3, 10) == pytest.approx(0.1)
    assert glide(effect, 1e-3, 1e-3, 10) == pytest.approx(0.2)
    assert glide(effect, -1e-5, 1e-3, 10) == pytest.approx(0.0, abs=1e-12)
    assert glide(effect, -1e-4, 1e-3, 10) == pytest.approx(-0.2)
    effect.reset()
    assert effect.step(0.0, 0.0, 0.0, 0.0, 1e-3) == 0.0


@pytest.mark.parametrize("steps", [1, 7, 1000])
@pytest.mark.parametrize("speed", [1e-4, 0.02])
def test_dahl_follows_its_closed_form_at_any_speed_and_step(steps: int, speed: float) -> None:
    force_n, stiffness_n_m = 0.08, 250.0
    effect = PreslidingHysteresis(force_n=force_n, stiffness_n_m=stiffness_n_m)
    out, back = 5e-4, 2e-4
    u = 1 - exp(-stiffness_n_m * out / force_n)
    assert glide(effect, out, speed, steps) == pytest.approx(force_n * u, rel=1e-9)
    reversed_u = (1 + u) * exp(-stiffness_n_m * back / force_n) - 1
    assert glide(effect, -back, speed, steps) == pytest.approx(force_n * reversed_u, rel=1e-9)


def test_dahl_starts_with_its_stiffness_and_holds_at_rest() -> None:
    effect = PreslidingHysteresis(force_n=0.08, stiffness_n_m=250.0)
    start = glide(effect, 1e-8, 1e-3, 1)
    assert start == pytest.approx(250.0 * 1e-8, rel=1e-4)
    assert effect.step(0.0, 0.0, 0.0, 0.0, 1.0) == start


def test_dahl_loses_the_loop_area_of_the_steady_cycle() -> None:
    force_n, stiffness_n_m, stroke_m, steps = 0.08, 250.0, 6e-4, 4000
    effect = PreslidingHysteresis(force_n=force_n, stiffness_n_m=stiffness_n_m)
    length = force_n / stiffness_n_m
    for _ in range(10):
        glide(effect, stroke_m, 0.01, 1)
        glide(effect, -stroke_m, 0.01, 1)
    dx, area = stroke_m / steps, 0.0
    before = effect.step(0.0, 0.0, 0.0, 0.0, 1.0)
    for sign in (1.0, -1.0):
        for _ in range(steps):
            after = effect.step(0.0, 0.0, sign, 0.0, dx)
            area += 0.5 * (before + after) * sign * dx
            before = after
    decay = exp(-stroke_m / length)
    turning = (1 - decay) / (1 + decay)
    expected = 2 * force_n * (stroke_m - (1 + turning) * length * (1 - decay))
    assert area == pytest.approx(expected, rel=1e-4)


def test_position_dependent_friction_grows_with_the_inserted_length() -> None:
    effect = PositionDependentFriction(force_per_length_n_m=2.0)
    assert effect.step(0.0, 0.05, 0.01, 0.0, 1e-3) == pytest.approx(0.1)
    assert effect.step(0.0, 0.05, -0.01, 0.0, 1e-3) == pytest.approx(-0.1)
    assert effect.step(0.0, -0.05, 0.01, 0.0, 1e-3) == 0.0


@pytest.mark.parametrize("steps", [1, 13, 2000])
def test_stress_relaxation_builds_up_and_fades_exponentially(steps: int) -> None:
    k, tau, v, ramp_s, hold_s = 6.0, 0.6, 0.02, 0.5, 0.9
    effect = StressRelaxation(stiffness_n_m=k, time_constant_s=tau)
    ramp = [effect.step(0.0, 0.0, v, 0.0, ramp_s / steps) for _ in range(steps)][-1]
    assert ramp == pytest.approx(k * v * tau * (1 - exp(-ramp_s / tau)), rel=1e-9)
    hold = [effect.step(0.0, 0.0, 0.0, 0.0, hold_s / steps) for _ in range(steps)][-1]
    assert hold == pytest.approx(ramp * exp(-hold_s / tau), rel=1e-9)


def test_stiffening_is_its_polynomial() -> None:
    effect = Stiffening(quadratic_n_m2=30.0, cubic_n_m3=400.0)
    assert effect.step(0.0, 0.1, 0.0, 0.0, 1e-3) == pytest.approx(30.0 * 0.01 + 400.0 * 0.001)
    assert effect.step(0.0, -0.1, 0.0, 0.0, 1e-3) == pytest.approx(30.0 * 0.01 - 400.0 * 0.001)


def test_pulsation_is_periodic_with_its_second_harmonic() -> None:
    effect = Pulsation(amplitude_n=0.5, frequency_hz=1.25, phase_rad=0.3, second_harmonic_ratio=0.2)
    p = 2 * pi * 1.25 * 0.7 + 0.3
    force = effect.step(0.7, 0.0, 0.0, 0.0, 1e-3)
    assert force == pytest.approx(0.5 * (sin(p) + 0.2 * sin(2 * p)))
    assert effect.step(0.7 + 3 / 1.25, 0.0, 0.0, 0.0, 1e-3) == pytest.approx(force)


def test_bias_and_drift_need_no_motion() -> None:
    assert Bias(force_n=-0.04).step(9.0, 0.0, 0.0, 0.0, 1e-3) == -0.04
    assert SensorDrift(rate_n_s=1e-3).step(9.0, 0.0, 0.0, 0.0, 1e-3) == pytest.approx(9e-3)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), True, "0.1", None])
def test_a_bad_value_is_refused_in_one_line(value: object) -> None:
    with pytest.raises(
        ValueError, match=r"^coulomb_friction\.force_n = .*: expected a number in \[0, 10000\] N$"
    ):
        CoulombFriction(force_n=value)  # type: ignore[arg-type]


def test_an_unknown_parameter_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"^bias.force: unknown parameter, expected one of force_n$"):
        Bias(force=1.0)
