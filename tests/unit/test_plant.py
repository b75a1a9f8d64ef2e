"""The simulated world: stage, load cell, contact, recorded forces, hidden effects."""

from collections.abc import Callable
from math import cos, nan, pi, sin, sqrt
from statistics import fmean
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.common.causes.model import SCHEMA
from forefeel.common.errors import ConfigurationError
from forefeel.common.messages import Grip
from forefeel.common.recording.recording import Array
from forefeel.devices.simulated.recorded import RecordedLoadCell
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.plant.settings import (
    LoadCellSettings,
    PresetName,
    StageSettings,
    WorldSettings,
    preset,
    world_settings,
)
from forefeel.slave.plant.stage import PlantStage
from forefeel.slave.plant.world import PlantLoadCell, SimulatedWorld

MS = 1_000_000
QUIET = {"noise_n": 0.0, "bias_n": 0.0, "drift_n_s": 0.0, "bits": 32}
Motion = Callable[[float], tuple[float, float]]


def stroke(length_m: float, duration_s: float) -> Motion:
    """(x, v) of a smooth way there and back."""

    def at(t: float) -> tuple[float, float]:
        p = 2 * pi * t / duration_s
        return 0.5 * length_m * (1 - cos(p)), length_m * pi / duration_s * sin(p)

    return at


def drive(world: SimulatedWorld, motion: Motion, span_s: float, start_ms: int = 0) -> list[LoadCellReading]:
    """Commands the motion at 1 kHz from the given time on; the reading after each ms."""
    readings = []
    for tick in range(round(span_s * 1000)):
        world.set_target(*motion(tick * 1e-3), (start_ms + tick) * MS)
        world.advance((start_ms + tick + 1) * MS)
        readings.append(world.load_cell_reading())
    return readings


def rms(values: list[float]) -> float:
    return sqrt(fmean(value * value for value in values))


def reference_force(settings: WorldSettings, motion: Motion, span_s: float) -> list[float]:
    """The same world at 100 kHz by explicit Euler, from the equations, not the product; one per ms."""
    p: dict[str, list[dict[str, float]]] = {}
    for entry in settings.contact.effects:
        p.setdefault(entry.effect, []).append(dict(entry.parameters))
    dahl, wall, branch = p["presliding_hysteresis"][0], p["mass_damper_spring"][0], p["stress_relaxation"][0]
    contact_m = p["contact_loss"][0]["contact_position_m"]
    capstan = p["position_dependent_friction"][0]["force_per_length_n_m"]
    w, cutoff = 2 * pi * settings.stage.bandwidth_hz, 2 * pi * settings.load_cell.filter_hz
    most, dt = settings.stage.acceleration_limit_m_s2, 1e-5
    x = v = dahl_n = branch_n = read_n = 0.0
    samples = []
    for step in range(1, round(span_s / dt) + 1):
        t = step * dt
        target, feed = motion(t)
        a = max(-most, min(most, w * w * (target - x) + 2 * w * (feed - v)))
        x, v = x + v * dt, v + a * dt
        sign = (v > 0) - (v < 0)
        dahl_n += dahl["stiffness_n_m"] * (1 - dahl_n / dahl["force_n"] * sign) * v * dt
        force = dahl_n
        depth = x - contact_m
        if depth > 0:
            branch_n += (branch["stiffness_n_m"] * v - branch_n / branch["time_constant_s"]) * dt
            force += wall["mass_kg"] * a + wall["damping_n_s_m"] * v + wall["stiffness_n_m"] * depth
            force += branch_n + capstan * depth * sign
            for beat in p["pulsation"]:
                phase = 2 * pi * beat["frequency_hz"] * t + beat["phase_rad"]
                force += beat["amplitude_n"] * (sin(phase) + beat["second_harmonic_ratio"] * sin(2 * phase))
        else:
            branch_n = 0.0
        read_n += (force - read_n) * cutoff * dt
        if step % 100 == 0:
            samples.append(read_n)
    return samples


@pytest.mark.parametrize("name", ["catheter", "guidewire"])
def test_the_force_agrees_with_a_fine_integration_of_the_equations(name: PresetName) -> None:
    settings = world_settings({"preset": name, "load_cell": QUIET})
    motion = stroke(0.03, 1.5)
    ours = [r.force_n for r in drive(SimulatedWorld(settings, 0), motion, 1.5)]
    reference = reference_force(settings, motion, 1.5)
    peak = max(map(abs, reference))
    errors = [abs(f - g) for f, g in zip(ours, reference, strict=True)]
    assert rms(errors) < 2e-3 * peak
    assert sorted(errors)[int(0.99 * len(errors))] < 5e-3 * peak


def way(start_m: float, end_m: float) -> Motion:
    """Half a stroke in 1 s, then rest."""
    there = stroke(end_m - start_m, 2.0)
    return lambda t: (start_m + there(min(t, 1.0))[0], there(min(t, 1.0))[1])


def test_strokes_add_up_when_the_fixture_regrips() -> None:
    world = SimulatedWorld(world_settings({"load_cell": QUIET}), 0)
    world.advance(0)
    strokes = ((Grip.CLOSED, 0.0, 0.03), (Grip.OPEN, 0.03, 0.0), (Grip.CLOSED, 0.0, 0.02))
    inserted_m, forces_n = list[float](), list[float]()
    for number, (grip, start_m, end_m) in enumerate(strokes):
        assert world.grip(grip) is grip
        drive(world, way(start_m, end_m), 1.2, 1200 * number)
        inserted_m.append(world.inserted_m)
        forces_n.append(world.load_cell_reading().force_n)
        assert world.stage_readback()[0] == pytest.approx(end_m, abs=1e-5)
    assert inserted_m == pytest.approx([0.03, 0.03, 0.05], abs=2e-5)
    assert inserted_m[1] == inserted_m[0]
    assert forces_n[1] == pytest.approx(0.0, abs=1e-9)
    assert forces_n[2] > forces_n[0] > 0.1


def test_a_stalled_host_finds_the_stage_at_rest_after_a_bounded_catch_up() -> None:
    world, limits = SimulatedWorld(preset("catheter"), 0), CATCH
    world.advance(0)
    world.set_target(0.12, 0.0, 0)
    world.advance(50 * MS)
    moving_m, velocity = world.stage_readback()
    assert velocity > 0.1
    world.advance(24 * 3600 * 1000 * MS)
    position_m, velocity = world.stage_readback()
    stop_m = limits.velocity_limit_m_s**2 / (2 * limits.acceleration_limit_m_s2) + 1e-4
    assert velocity == 0.0
    assert moving_m < position_m < moving_m + stop_m
    assert world.load_cell_reading().valid


SETPOINTS = st.lists(
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(1, 400)), min_size=1, max_size=12
)


DT = 2e-4
CATCH = preset("catheter").stage


def stage(**changes: float) -> PlantStage:
    return PlantStage(StageSettings(**{**CATCH.model_dump(), **changes}), DT)


def run(plant: PlantStage, start_s: float, span_s: float) -> list[tuple[float, float, float]]:
    """(x, v, a) of each step over a span without new setpoints."""
    first = round(start_s / DT)
    return [plant.step((first + i + 1) * DT) for i in range(round(span_s / DT))]


@settings(deadline=None, max_examples=60, derandomize=True)
@given(SETPOINTS, st.floats(0.002, 0.06), st.floats(0.01, 1.0), st.floats(0.2, 50.0), st.floats(1.0, 200.0))
def test_no_setpoint_breaks_a_limit(
    setpoints: list[tuple[float, float, int]],
    travel_m: float,
    velocity: float,
    acceleration: float,
    hz: float,
) -> None:
    limits = {"velocity_limit_m_s": velocity, "acceleration_limit_m_s2": acceleration, "bandwidth_hz": hz}
    plant = stage(travel_lower_m=-travel_m, travel_upper_m=travel_m, **limits)
    step, before = 0, plant.position_m
    for position_m, velocity_m_s, steps in setpoints:
        applied_m = plant.command(position_m, velocity_m_s, step * DT)
        assert -travel_m <= applied_m <= travel_m
        for _ in range(steps):
            step += 1
            x, v, a = plant.step(step * DT)
            assert -travel_m <= x <= travel_m
            assert abs(x - before) <= (velocity + acceleration * DT) * DT  # no crash into an end
            before = x
            assert abs(v) <= velocity * (1 + 1e-9)
            assert abs(a) <= acceleration * (1 + 1e-6)


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


PERFECT = LoadCellSettings(full_scale_n=1.0, bits=16, filter_hz=200.0, noise_n=0.0, bias_n=0.0, drift_n_s=0.0)


@pytest.mark.parametrize(
    ("force_n", "counts", "valid"),
    [
        (0.94, round(0.94 * 32767), True),
        (0.96, round(0.96 * 32767), False),
        (5.0, 32767, False),
        (-5.0, -32767, False),
    ],
)
def test_reading_beyond_95_percent_of_full_scale_is_invalid(force_n: float, counts: int, valid: bool) -> None:
    cell = PlantLoadCell(PERFECT, seed=1)
    cell.filtered.value = force_n
    cell.convert(0.0)
    assert (cell.reading.raw_counts, cell.reading.valid) == (counts, valid)


@pytest.mark.parametrize(
    ("at_s", "force_n"),
    [
        *((0.0, 0.0), (0.005, 0.05), (0.0175, 0.25), (0.02, 0.3), (1.0, -0.2), (1.025, -0.15)),
        *((at_s, None) for at_s in (None, nan, -0.001, 1.06, 0.021, 0.5, 0.999)),
    ],
)
def test_recorded_force_is_interpolated_but_over_no_gap(at_s: float | None, force_n: float | None) -> None:
    cell = RecordedLoadCell([0.0, 0.01, 0.02, 1.0, 1.05], [0.0, 0.1, 0.3, -0.2, -0.1])
    ((read_n, counts, valid, *_),) = cell.read(123, at_s)
    assert read_n == pytest.approx(force_n or 0.0, abs=1e-12)
    assert valid is (force_n is not None)
    assert counts == round((force_n or 0.0) * 1e6)


WALL = {"effect": "mass_damper_spring", "parameters": {"damping_n_s_m": 0.5, "stiffness_n_m": 10.0}}
RELAXING = {"effect": "stress_relaxation", "parameters": {"stiffness_n_m": 8.0, "time_constant_s": 0.5}}
FRICTION = {"effect": "presliding_hysteresis", "parameters": {"force_n": 0.1, "stiffness_n_m": 100.0}}


def model(*effects: dict[str, Any]) -> dict[str, Any]:
    return {"schema": SCHEMA, "name": "world", "effects": list(effects)}


def forces(*effects: dict[str, Any], load_cell: dict[str, Any] = QUIET, **hidden: Any) -> Array:  # noqa: ANN401
    """The readings of 2 s of strokes in a world of these effects."""
    mapping: dict[str, Any] = {"contact": model(*effects), "load_cell": load_cell}
    if hidden:
        mapping["hidden"] = hidden
    world = SimulatedWorld(world_settings(mapping), 1)
    return np.array([reading.force_n for reading in drive(world, stroke(0.02, 1.3), 2.0)])


@pytest.mark.parametrize("hidden", [RELAXING, FRICTION], ids=["relaxation", "friction"])
def test_before_it_is_not_there_and_then_it_has_felt_the_motion_all_along(hidden: dict[str, Any]) -> None:
    switched = forces(WALL, effects=model(hidden), from_s=1.0)
    without, throughout = forces(WALL), forces(WALL, hidden)
    np.testing.assert_array_equal(switched[:999], without[:999])
    np.testing.assert_allclose(switched[1010:], throughout[1010:], atol=1e-6)  # behind the cell's filter
    assert np.abs(switched - without)[1010:].max() > 0.02


def test_a_sensor_acts_on_readings_behind_the_noise_and_from_its_instant_on() -> None:
    noisy = {**QUIET, "noise_n": 0.01}
    flat = {"effect": "sensor_saturation", "parameters": {"limit_n": 0.1}}
    always, later = (
        forces(WALL, flat, load_cell=noisy),
        forces(WALL, load_cell=noisy, effects=model(flat), from_s=1.5),
    )
    assert always.max() == pytest.approx(0.1, abs=1e-6), "flat tops, not tops with noise on them"
    assert np.count_nonzero(always > 0.0999) > 100
    assert later[:1499].max() > 0.2
    assert later[1500:].max() == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("hidden", "words"),
    [
        ({"effects": model({"effect": "contact_loss"})}, "a second contact effect"),
        ({"effects": model({"effect": "magic"})}, "magic"),
        ({"effects": model(FRICTION), "from_s": -1.0}, "from_s"),
        ({"effects": model(FRICTION), "model": "m.yaml"}, "expected one of them"),
        ({"from_s": 1.0}, "effects"),
    ],
)
def test_what_can_not_be_hidden_is_refused_in_one_line(hidden: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words) as refused:
        world_settings({"preset": "catheter", "hidden": hidden})
    assert "\n" not in str(refused.value)
