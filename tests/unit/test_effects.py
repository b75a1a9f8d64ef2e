"""Effects against closed forms."""

from itertools import pairwise
from math import cos, e, exp, pi, sin, sqrt

import numpy as np
import pytest

from forefeel.common.causes import friction, sensor, wall
from forefeel.common.causes.base import ForceEffect, SensorEffect
from forefeel.common.causes.capstan import Capstan
from forefeel.common.causes.damping import AsymmetricDamping, HuntCrossleyDamping, QuadraticDrag
from forefeel.common.causes.gripper import SLIP_M_S, Buckling, GripperSlip
from forefeel.common.causes.motion import BAND_M_S, MotionSample
from forefeel.common.causes.periodic import GravityLoad, MainsHum, Pulsation
from forefeel.common.causes.runtime import ContactRuntime
from forefeel.common.causes.transmission import Backlash
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance
from forefeel.report.wording import plain_value
from tests.unit.model_samples import effect, model

DT = 1e-3


def stepped(
    effect: ForceEffect, t: float = 0.0, x: float = 0.0, v: float = 0.0, a: float = 0.0, dt: float = DT
) -> float:
    """The force in N after a step."""
    phi = effect.regressors(MotionSample(t, x, v, a, dt))
    return float(np.dot(effect.linear_values, phi))


def read(effect: SensorEffect, force_n: float, t: float = 0.0, dt: float = DT) -> float:
    return float(effect.reading(MotionSample(t, 0.0, 0.0, 0.0, dt), force_n))


STRIBECK = friction.StribeckFriction(coulomb_n=0.1, static_n=0.3, stribeck_velocity_m_s=0.01)


@pytest.mark.parametrize(
    ("effect", "motion", "expected_n"),
    [
        (wall.MassDamperSpring(mass_kg=0.01, damping_n_s_m=0.1, stiffness_n_m=1.0), (0.3, 0.2, 5.0), 0.37),
        (friction.CoulombFriction(forward_n=0.3, backward_n=0.1), (0.0, 0.02, 0.0), 0.3),
        (friction.CoulombFriction(forward_n=0.3, backward_n=0.1), (0.0, -0.02, 0.0), -0.1),
        (friction.CoulombFriction(forward_n=0.3, backward_n=0.1), (0.0, BAND_M_S / 2, 0.0), 0.15),
        (friction.CoulombFriction(force_n=0.2), (0.0, 0.0, 0.0), 0.0),
        (STRIBECK, (0.0, 1e-6, 0.0), 0.03),
        (STRIBECK, (0.0, 0.01, 0.0), 0.1 + 0.2 / e),
        (STRIBECK, (0.0, -0.01, 0.0), -0.1 - 0.2 / e),
        (STRIBECK, (0.0, 0.1, 0.0), 0.1),
        (friction.PositionDependentFriction(force_per_length_n_m=2.0), (0.05, 0.01, 0.0), 0.1),
        (friction.PositionDependentFriction(force_per_length_n_m=2.0), (0.05, -0.01, 0.0), -0.1),
        (friction.PositionDependentFriction(force_per_length_n_m=2.0), (-0.05, 0.01, 0.0), 0.0),
        (HuntCrossleyDamping(damping_n_s_m2=40.0), (0.02, -0.05, 0.0), -0.04),
        (HuntCrossleyDamping(damping_n_s_m2=40.0), (-0.02, 0.05, 0.0), 0.0),
        (QuadraticDrag(drag_n_s2_m2=30.0), (0.0, 0.2, 0.0), 1.2),
        (QuadraticDrag(drag_n_s2_m2=30.0), (0.0, -0.2, 0.0), -1.2),
        (AsymmetricDamping(forward_n_s_m=2.0, backward_n_s_m=0.5), (0.0, 0.1, 0.0), 0.2),
        (AsymmetricDamping(forward_n_s_m=2.0, backward_n_s_m=0.5), (0.0, -0.1, 0.0), -0.05),
        (wall.Stiffening(quadratic_n_m2=30.0, cubic_n_m3=400.0), (0.1, 0.0, 0.0), 0.7),
        (wall.Stiffening(quadratic_n_m2=30.0, cubic_n_m3=400.0), (-0.1, 0.0, 0.0), -0.1),
        (wall.ExponentialWall(exponential_n=0.05, length_m=4e-3), (0.01, 0.0, 0.0), 0.05 * (exp(2.5) - 3.5)),
        (
            wall.ExponentialWall(exponential_n=0.05, length_m=4e-3),
            (-0.01, 0.0, 0.0),
            0.05 * (exp(-2.5) + 1.5),
        ),
        (wall.ExponentialWall(exponential_n=1.0, length_m=1e-5), (10.0, 0.0, 0.0), exp(50.0) - 51.0),
        (GravityLoad(sine_n=0.5, cosine_n=-2.0), (1.2, 0.0, 0.0), 0.5 * sin(1.2) - 2.0 * cos(1.2)),
        (sensor.Bias(force_n=-0.04), (0.0, 0.0, 0.0), -0.04),
        (sensor.SensorDrift(rate_n_s=1e-3), (0.0, 0.0, 0.0), 9e-3),
        (
            sensor.SensorDrift(rate_n_s=1e-3, settling_s=2.0, from_s=5.0),
            (0.0, 0.0, 0.0),
            2e-3 * (1.0 - exp(-2.0)),
        ),
    ],
    ids=lambda value: value.name if isinstance(value, ForceEffect) else "",
)
def test_force_is_its_closed_form(
    effect: ForceEffect, motion: tuple[float, float, float], expected_n: float
) -> None:
    assert stepped(effect, 9.0, *motion) == pytest.approx(expected_n, rel=1e-4)


def test_a_weight_is_described_by_its_size_and_by_where_it_hangs_and_stands() -> None:
    text = GravityLoad.described({"sine_n": 3.0, "cosine_n": -4.0}, plain_value)
    assert text == ": 5 N at its farthest, it hangs at 0.93 rad and stands upright at -2.21 rad"
    turned = GravityLoad.described({"sine_n": -2.0, "cosine_n": -1e-3}, plain_value)
    assert turned == ": 2 N at its farthest, it hangs at 3.14 rad and stands upright at 0.00 rad"


@pytest.mark.parametrize(
    ("effect", "readings_n"),
    [
        (sensor.SensorSaturation(limit_n=0.5), [(-2.0, -0.5), (-0.5, -0.5), (0.2, 0.2), (0.7, 0.5)]),
        (
            sensor.SensorQuantisation(step_n=0.01),
            [(-0.0149, -0.01), (0.0049, 0.0), (0.0051, 0.01), (0.026, 0.03)],
        ),
        (sensor.TimeDelay(delay_s=0.0), [(1.0, 1.0), (3.0, 3.0)]),
    ],
    ids=lambda value: value.name if isinstance(value, SensorEffect) else "",
)
def test_reading_is_its_closed_form(effect: SensorEffect, readings_n: list[tuple[float, float]]) -> None:
    found = [read(effect, force_n) for force_n, _ in readings_n]
    assert found == pytest.approx([reading_n for _, reading_n in readings_n])


def glide(effect: ForceEffect, distance_m: float, speed_m_s: float, steps: int) -> float:
    """The force after moving by `distance_m` at constant speed in so many steps."""
    dt = abs(distance_m / speed_m_s) / steps
    v = speed_m_s if distance_m > 0 else -speed_m_s
    force = 0.0
    for _ in range(steps):
        force = stepped(effect, v=v, dt=dt)
    return force


def test_with_a_breakaway_friction_turns_over_twice_that_distance() -> None:
    effect = friction.CoulombFriction(force_n=0.2, breakaway_m=1e-5)
    assert glide(effect, 5e-6, 1e-3, 10) == pytest.approx(0.1)
    assert glide(effect, 1e-3, 1e-3, 10) == pytest.approx(0.2)
    assert glide(effect, -1e-5, 1e-3, 10) == pytest.approx(0.0, abs=1e-12)
    assert glide(effect, -1e-4, 1e-3, 10) == pytest.approx(-0.2)
    effect.reset()
    assert stepped(effect) == 0.0


def test_with_a_transition_speed_friction_has_three_quarters_of_its_size_there() -> None:
    effect = friction.CoulombFriction(forward_n=0.2, backward_n=0.1, transition_speed_m_s=1e-3)
    forces_n = [stepped(effect, v=v) for v in (-1.0, -1e-3, 0.0, 1e-3, 1.0)]
    assert forces_n == pytest.approx([-0.1, -0.0762, 0.0, 0.1523, 0.2], abs=1e-4)


@pytest.mark.parametrize("steps", [1, 7, 1000])
@pytest.mark.parametrize("speed", [1e-4, 0.02])
def test_dahl_follows_its_closed_form_at_any_speed_and_step(steps: int, speed: float) -> None:
    force_n, stiffness_n_m = 0.08, 250.0
    effect = friction.PreslidingHysteresis(force_n=force_n, stiffness_n_m=stiffness_n_m)
    out, back = 5e-4, 2e-4
    u = 1 - exp(-stiffness_n_m * out / force_n)
    assert glide(effect, out, speed, steps) == pytest.approx(force_n * u, rel=1e-9)
    reversed_u = (1 + u) * exp(-stiffness_n_m * back / force_n) - 1
    assert glide(effect, -back, speed, steps) == pytest.approx(force_n * reversed_u, rel=1e-9)


@pytest.mark.parametrize("steps", [1, 13, 2000])
def test_stress_relaxation_builds_up_and_fades_exponentially(steps: int) -> None:
    k, tau, v, ramp_s, hold_s = 6.0, 0.6, 0.02, 0.5, 0.9
    effect = wall.StressRelaxation(stiffness_n_m=k, time_constant_s=tau)
    ramp = [stepped(effect, v=v, dt=ramp_s / steps) for _ in range(steps)][-1]
    assert ramp == pytest.approx(k * v * tau * (1 - exp(-ramp_s / tau)), rel=1e-9)
    hold = [stepped(effect, dt=hold_s / steps) for _ in range(steps)][-1]
    assert hold == pytest.approx(ramp * exp(-hold_s / tau), rel=1e-9)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), True, "0.1", None])
def test_a_bad_value_is_refused_in_one_line(value: object) -> None:
    with pytest.raises(
        ValueError, match=r"^coulomb_friction\.force_n = .*: expected a number in \[0, 10000\] N$"
    ):
        friction.CoulombFriction(force_n=value)  # type: ignore[arg-type]


def test_backlash_loses_its_width_at_each_reversal() -> None:
    effect = Backlash(width_m=0.002)
    path = [0.0, 0.001, 0.002, 0.010, 0.009, 0.008, 0.007, 0.005]
    instrument = [effect.moved(MotionSample(0.0, x, 1.0, 2.0, DT)) for x in path]
    expected_m = [0.0, 0.0, 0.001, 0.009, 0.009, 0.009, 0.008, 0.006]
    assert [m.x for m in instrument] == pytest.approx(expected_m)
    assert [m.v for m in instrument] == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert [m.a for m in instrument] == [2.0 * m.v for m in instrument]


def test_a_damped_wall_pushes_and_does_not_pull() -> None:
    effect = wall.ContactLoss(contact_position_m=0.01, release_s=0.1)
    assert effect.contact(MotionSample(0.0, 0.013, -0.029, 0.0, DT)) == (pytest.approx(0.003), 1.0)
    assert effect.contact(MotionSample(0.0, 0.013, -0.031, 0.0, DT))[1] == 0.0, "spring and damper would pull"
    assert effect.contact(MotionSample(0.0, 0.009, 1.0, 0.0, DT))[1] == 0.0


def test_a_wall_moves_on_where_it_is_pushed_above_its_limit() -> None:
    effect = wall.YieldingWall(yield_n=0.2, stiffness_n_m=50.0, contact_position_m=0.01)
    places, forces_n = (0.009, 0.013, 0.016, 0.014, 0.011, 0.017, 0.015), (0.0, 0.15, 0.2, 0.1, 0.0, 0.2, 0.1)
    assert [stepped(effect, x=x) for x in places] == pytest.approx(forces_n)


def test_a_tip_lets_go_above_a_force_and_holds_again_below_another() -> None:
    effect = wall.Prolapse(stiffness_n_m=50.0, limit_n=0.5, again_n=0.1, kept=0.2, rest_position_m=0.002)
    course = [(0.011, 1.0), (0.013, 0.2), (0.005, 0.2), (0.0039, 1.0), (0.011, 1.0), (0.0121, 0.2)]
    for x, share in course:
        stepped(effect, x=x)  # in the step in which it switches it has both forces in turn
        assert 50.0 * (x - 0.002) + stepped(effect, x=x) == pytest.approx(share * 50.0 * (x - 0.002))


@pytest.mark.parametrize(
    ("x", "v", "tip_n", "exponent"),
    [(0.01, 1.0, 1.0, 0.3), (0.01, -1.0, 1.0, -0.3), (0.01, -1.0, -1.0, 0.3), (-0.01, 1.0, 1.0, 0.1)],
)
def test_a_shaft_whose_bends_grow_with_its_length_multiplies_more_the_deeper_it_is(
    x: float, v: float, tip_n: float, exponent: float
) -> None:
    effect = Capstan(wrap_rad=0.1, wrap_rad_m=20.0)
    assert effect.factor(MotionSample(0.0, x, v, 0.0, DT), tip_n) == pytest.approx(exp(exponent))


@pytest.mark.parametrize(
    ("x", "force_n", "borne_n"),
    [(0.02, 0.3, 0.3), (0.02, -9.0, -9.0), (0.02, 9.0, 0.5), (0.07, 9.0, 8.0), (0.2, 900.0, 800.0)],
)
def test_a_wire_bears_eulers_load_of_what_is_free(x: float, force_n: float, borne_n: float) -> None:
    effect = Buckling(euler_n_m2=8e-4, free_length_m=0.06 if x == 0.02 else 0.08)
    assert force_n * effect.factor(MotionSample(0.0, x, 0.0, 0.0, DT), force_n) == pytest.approx(borne_n)


def pulled(effect: GripperSlip, path_m: list[float], stiffness_n_m: float) -> tuple[list[float], list[float]]:
    """Forces of a spring behind the gripper, and ways slipped, along a path at steps of DT."""
    spring = wall.MassDamperSpring(mass_kg=0.0, damping_n_s_m=0.0, stiffness_n_m=stiffness_n_m)
    runtime = ContactRuntime([(spring, None), (effect, None)])
    forces = [(runtime.step(i * DT, x, 0.0, 0.0, DT), x - runtime.instrument_m) for i, x in enumerate(path_m)]
    return [f for f, _ in forces], [slipped for _, slipped in forces]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wire_jumps_by_the_same_way_each_time_that_the_force_passes_what_holds(side: float) -> None:
    path_m = [side * min(1e-5 * i, 0.01) for i in range(1400)]
    forces, slipped = pulled(GripperSlip(holding_n=0.5, slipped_m=2e-3), path_m, 100.0)
    assert max(side * f for f in forces) == pytest.approx(0.5, abs=2e-3)
    assert side * slipped[-1] == pytest.approx(3 * 2e-3)  # at 5, 7 and 9 mm
    assert sum(a != b for a, b in pairwise(slipped)) == 3 * -(-2e-3 // (SLIP_M_S * DT))
    assert side * forces[-1] == pytest.approx(0.4)


def test_a_wire_creeps_until_the_force_is_what_holds() -> None:
    path_m = [0.01] * 2000
    forces, _ = pulled(GripperSlip(holding_n=0.5, creep_n_s_m=20.0), path_m, 100.0)
    assert forces[201] == pytest.approx(0.5 + 0.5 * exp(-0.2 * 100.0 / 20.0), rel=5e-3)
    assert forces[-1] == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("steps", [1, 10, 1000])
def test_sensor_lag_answers_a_step_exactly(steps: int) -> None:
    effect = sensor.SensorLag(time_constant_s=0.02)
    assert read(effect, 1.0) == 1.0
    readings = [read(effect, 3.0, dt=0.05 / steps) for _ in range(steps)]
    assert readings[-1] == pytest.approx(3.0 - 2.0 * exp(-0.05 / 0.02), rel=1e-9)


def test_a_changed_stiffness_is_the_ratio_of_the_old_one() -> None:
    spring = effect("mass_damper_spring", mass_kg=0.0, damping_n_s_m=0.0, stiffness_n_m=8.0)
    change = effect("stiffness_change", stiffness_n_m=8.0, time_s=2.5, ratio=0.25, rest_position_m=0.01)
    runtime = model(spring, effect("bias", force_n=-8.0 * 0.01), change).runtime()
    assert runtime.step(2.499, 0.03, 0.0, 0.0, DT) == pytest.approx(8.0 * 0.02)
    assert runtime.step(2.5, 0.03, 0.0, 0.0, DT) == pytest.approx(0.25 * 8.0 * 0.02)


@pytest.mark.parametrize("kind", [MainsHum, Pulsation])
def test_a_periodic_force_has_three_harmonics_with_phases_of_their_own(
    kind: type[MainsHum] | type[Pulsation],
) -> None:
    values = {
        "amplitude_n": 0.02, "frequency_hz": 49.7, "phase_rad": 0.4, "second_harmonic_ratio": 0.3,
        "second_harmonic_phase_rad": -1.0, "third_harmonic_ratio": 2.0, "third_harmonic_phase_rad": 2.0,
    }  # fmt: skip
    p = 2 * pi * 49.7 * 1.234 + 0.4
    force = 0.02 * (sin(p) + 0.3 * sin(2 * p - 1.0) + 2.0 * sin(3 * p + 2.0))
    assert stepped(kind(**values), 1.234) == pytest.approx(force)


def test_a_delay_gives_the_force_of_then() -> None:
    effect = sensor.TimeDelay(delay_s=0.0255)
    readings = [read(effect, sin(i * DT), i * DT) for i in range(200)]
    assert readings[:26] == [0.0] * 26
    expected = [sin(i * DT - 0.0255) for i in range(26, 200)]
    assert readings[26:] == pytest.approx(expected, abs=2e-7)
    effect.reset()
    assert read(effect, 0.7) == 0.7


def spikes(effect: sensor.SensorSpikes, duration_s: float, dt: float) -> list[float]:
    return [read(effect, 0.0, i * dt, dt) for i in range(round(duration_s / dt))]


def test_spikes_come_at_their_rate_and_size_and_alone() -> None:
    found = spikes(sensor.SensorSpikes(rate_hz=2.0, amplitude_n=0.4, seed=7), 200.0, DT)
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
    coarse = spikes(sensor.SensorSpikes(**values, seed=1), 20.0, 1e-3)
    fine = spikes(sensor.SensorSpikes(**values, seed=1), 20.0, 1e-4)
    assert fine[::10] == coarse
    assert spikes(sensor.SensorSpikes(**values, seed=2), 20.0, 1e-3) != coarse
    slow = spikes(sensor.SensorSpikes(**values, seed=1), 20.0, 0.02)
    assert abs(np.count_nonzero(slow) - np.count_nonzero(coarse)) <= 3  # two may fall into one step


@pytest.mark.parametrize("steps", [1, 7, 400])
def test_a_resonance_rings_as_its_closed_form(steps: int) -> None:
    frequency_hz, damping_ratio, accelerated_s, free_s, a = 8.0, 0.1, 0.05, 0.11, 2.0
    effect = UnmodelledResonance(
        stiffness_n_m=30.0, damping_n_s_m=0.2, frequency_hz=frequency_hz, damping_ratio=damping_ratio
    )
    for _ in range(steps):
        stepped(effect, a=a, dt=accelerated_s / steps)
    for _ in range(steps):
        force = stepped(effect, dt=free_s / steps)
    w = 2 * pi * frequency_hz
    swing, decay = w * sqrt(1 - damping_ratio**2), damping_ratio * w

    def answer(t: float) -> tuple[float, float]:
        """z and z' of the answer to a step of acceleration at 0."""
        lag = 1 - exp(-decay * t) * (cos(swing * t) + decay / swing * sin(swing * t))
        return a / w**2 * lag, a / swing * exp(-decay * t) * sin(swing * t)

    (z1, v1), (z2, v2) = answer(accelerated_s + free_s), answer(free_s)
    assert force == pytest.approx(30.0 * (z1 - z2) + 0.2 * (v1 - v2), rel=1e-9)
