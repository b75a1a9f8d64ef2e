"""The simulated world: against an independent fine integration, repeatability, strokes, presets, stalls."""

from collections.abc import Callable
from math import cos, pi, sin, sqrt
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from forefeel.common.config import Settings, checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.messages import Grip
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.plant.settings import PresetName, WorldSettings, preset, world_settings
from forefeel.slave.plant.world import SimulatedWorld

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


def move(world: SimulatedWorld, start_m: float, end_m: float, start_ms: int) -> int:
    """Half a cosine from start to end in 1 s, then 0.2 s of rest; the time after it in ms."""

    def at(t: float) -> tuple[float, float]:
        p = pi * min(t, 1.0)
        return start_m + (end_m - start_m) * 0.5 * (1 - cos(p)), (end_m - start_m) * 0.5 * pi * sin(p)

    drive(world, at, 1.2, start_ms)
    return start_ms + 1200


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


def test_equal_seeds_and_calls_repeat_bit_for_bit() -> None:
    motion = stroke(0.03, 1.0)
    first, again, other = (
        drive(SimulatedWorld(preset("guidewire"), seed), motion, 0.5) for seed in (7, 7, 8)
    )
    assert first == again
    assert first != other


def test_strokes_add_up_when_the_fixture_regrips() -> None:
    world = SimulatedWorld(world_settings({"load_cell": QUIET}), 0)
    world.advance(0)
    now_ms = move(world, 0.0, 0.03, 0)
    pushed_m, loaded_n = world.inserted_m, world.load_cell_reading().force_n
    assert pushed_m == pytest.approx(0.03, abs=1e-5)
    assert loaded_n > 0.1

    assert world.grip(Grip.OPEN) is Grip.OPEN
    now_ms = move(world, 0.03, 0.0, now_ms)
    assert world.inserted_m == pushed_m
    assert world.stage_readback()[0] == pytest.approx(0.0, abs=1e-5)
    assert world.load_cell_reading().force_n == pytest.approx(0.0, abs=1e-9)

    assert world.grip(Grip.CLOSED) is Grip.CLOSED
    now_ms = move(world, 0.0, 0.02, now_ms)
    assert world.inserted_m == pytest.approx(0.05, abs=2e-5)
    assert world.load_cell_reading().force_n > loaded_n


def test_a_stalled_host_finds_the_stage_at_rest_after_a_bounded_catch_up() -> None:
    world = SimulatedWorld(preset("catheter"), 0)
    world.advance(0)
    world.set_target(0.12, 0.0, 0)
    world.advance(50 * MS)
    moving_m, velocity = world.stage_readback()
    assert velocity > 0.1
    world.advance(24 * 3600 * 1000 * MS)
    position_m, velocity = world.stage_readback()
    assert velocity == 0.0
    assert moving_m < position_m < moving_m + velocity_stop_m()
    assert world.load_cell_reading().valid


def velocity_stop_m() -> float:
    stage = preset("catheter").stage
    return stage.velocity_limit_m_s**2 / (2 * stage.acceleration_limit_m_s2) + 1e-4


def test_a_preset_is_overridden_value_by_value() -> None:
    settings = world_settings({"preset": "guidewire", "load_cell": {"noise_n": 0.001}})
    plain = preset("guidewire")
    assert settings.load_cell.noise_n == 0.001
    assert settings.load_cell == plain.load_cell.model_copy(update={"noise_n": 0.001})
    assert (settings.stage, settings.contact) == (plain.stage, plain.contact)
    assert world_settings(settings.model_dump()) == settings


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"preset": "rope"}, r"preset = 'rope': input should be 'catheter' or 'guidewire'"),
        ({"load_cell": {"noise": 1}}, r"load_cell\.noise: unknown key"),
        ({"stage": {"bandwidth_hz": float("nan")}}, r"stage\.bandwidth_hz = nan: "),
        ({"stage": {"start_m": 0.5}}, r"stage: start_m = 0\.5: expected within travel"),
        (
            {"contact": {"effects": [{"effect": "x"}]}},
            r"contact: effects\[0\]\.effect: unknown effect 'x'",
        ),
    ],
)
def test_wrong_settings_are_refused_in_one_line(mapping: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message) as caught:
        world_settings(mapping)
    assert "\n" not in str(caught.value)


MODEL = """\
schema: forefeel.model/1
name: a spring
effects:
  - {effect: mass_damper_spring, parameters: {mass_kg: 0, damping_n_s_m: 0, stiffness_n_m: 30}}
"""


def test_a_model_file_beside_the_settings_is_the_contact(tmp_path: Path) -> None:
    class Axis(Settings):
        simulation: WorldSettings

    (tmp_path / "spring.yaml").write_text(MODEL)
    axis = checked(Axis, {"simulation": {"model": "spring.yaml"}}, "slave.yaml", directory=tmp_path)
    contact = axis.simulation.contact
    assert [entry.effect for entry in contact.effects] == ["mass_damper_spring"]
    assert contact.runtime().linear_values == (0.0, 0.0, 30.0)
    assert world_settings(axis.simulation.model_dump()) == axis.simulation
