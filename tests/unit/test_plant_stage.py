"""The simulated stage: limits, servo, watchdog, play, encoder."""

from math import exp, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.slave.plant.settings import StageSettings, preset
from forefeel.slave.plant.stage import PlantStage

DT = 1e-4
CATCH = preset("catheter").stage


def stage(**changes: float) -> PlantStage:
    return PlantStage(StageSettings(**{**CATCH.model_dump(), **changes}), DT)


def run(plant: PlantStage, start_s: float, span_s: float) -> list[tuple[float, float, float]]:
    """(x, v, a) of each step over a span without new setpoints."""
    first = round(start_s / DT)
    return [plant.step((first + i + 1) * DT) for i in range(round(span_s / DT))]


setpoints = st.lists(
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(1, 400)), min_size=1, max_size=12
)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(setpoints, st.floats(0.002, 0.06), st.floats(0.01, 1.0), st.floats(0.2, 50.0), st.floats(1.0, 200.0))
def test_no_setpoint_breaks_a_limit(
    sequence: list[tuple[float, float, int]],
    travel_m: float,
    velocity: float,
    acceleration: float,
    bandwidth: float,
) -> None:
    plant = stage(
        travel_lower_m=-travel_m,
        travel_upper_m=travel_m,
        velocity_limit_m_s=velocity,
        acceleration_limit_m_s2=acceleration,
        bandwidth_hz=bandwidth,
    )
    step, before = 0, plant.position_m
    for position_m, velocity_m_s, steps in sequence:
        applied_m = plant.command(position_m, velocity_m_s, step * DT)
        assert -travel_m <= applied_m <= travel_m
        for _ in range(steps):
            step += 1
            x, v, a = plant.step(step * DT)
            assert -travel_m <= x <= travel_m
            assert x - before == pytest.approx(v * DT, abs=1e-12)  # no crash into an end
            before = x
            assert abs(v) <= velocity * (1 + 1e-9)
            assert abs(a) <= acceleration * (1 + 1e-6)


def test_the_servo_settles_as_a_critically_damped_second_order_system() -> None:
    plant = stage(
        bandwidth_hz=5.0, acceleration_limit_m_s2=100.0, velocity_limit_m_s=5.0, device_watchdog_s=1.0
    )
    plant.command(0.01, 0.0, 0.0)
    w = 2 * pi * 5.0
    for i, (x, _, _) in enumerate(run(plant, 0.0, 0.3), start=1):
        t = i * DT
        assert x == pytest.approx(0.01 * (1 - (1 + w * t) * exp(-w * t)), abs=3e-5)


def test_extrapolation_is_bounded_when_setpoints_stop() -> None:
    plant = stage(device_watchdog_s=1.0)
    for tick in range(500):
        plant.command(0.04 * tick * 1e-3, 0.04, tick * 1e-3)
        run(plant, tick * 1e-3, 1e-3)
    x, v, _ = run(plant, 0.5, 0.4)[-1]
    assert x == pytest.approx(0.04 * (0.499 + 0.002), abs=1e-6)
    assert v == pytest.approx(0.0, abs=1e-9)


def test_the_watchdog_of_the_device_brakes_to_rest_and_holds() -> None:
    watchdog_s, most = CATCH.device_watchdog_s, CATCH.acceleration_limit_m_s2
    plant = stage()
    plant.command(0.12, 0.0, 0.0)
    under_way = run(plant, 0.0, watchdog_s)
    assert under_way[-1][1] == pytest.approx(CATCH.velocity_limit_m_s)
    braking = run(plant, watchdog_s, 0.5)
    speeds = [v for _, v, _ in braking]
    rest = speeds.index(0.0)
    assert rest * DT == pytest.approx(CATCH.velocity_limit_m_s / most, abs=2 * DT)
    assert set(speeds[rest:]) == {0.0}
    assert len({x for x, _, _ in braking[rest:]}) == 1
    assert all(abs(a) <= most * (1 + 1e-6) for _, _, a in braking)
    assert braking[-1][0] < 0.05


def test_play_lies_between_the_encoder_and_the_carriage() -> None:
    plant = stage(backlash_width_m=0.001, device_watchdog_s=1.0)
    plant.command(0.01, 0.0, 0.0)
    carriage_m = run(plant, 0.0, 0.5)[-1][0]
    assert carriage_m == pytest.approx(0.0095, abs=1e-6)
    assert plant.readback()[0] == pytest.approx(0.01, abs=1e-6)
    plant.command(0.0095, 0.0, 0.5)
    assert run(plant, 0.5, 0.5)[-1][0] == carriage_m
