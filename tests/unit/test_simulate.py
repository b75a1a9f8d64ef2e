"""Simulated recordings against closed forms and their own statistics."""

from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.recording import Recording
from forefeel.simulate.motion import (
    SMOOTHING_HZ,
    FollowedRecording,
    Hand,
    MotionPiece,
    MotionSource,
    multisine,
    sine,
)
from forefeel.simulate.run import SimulationOptions, simulate
from forefeel.simulate.world import integrate

QUIET = SimulationOptions(Path("model.yaml"), "sine", duration_s=3.0, noise_n=0.0, encoder_step_m=0.0)
WALL = {"mass_kg": 0.05, "damping_n_s_m": 0.8, "stiffness_n_m": 8.0}


def model(*effects: tuple[str, dict[str, float]]) -> ContactModel:
    listed: list[dict[str, Any]] = [{"effect": name, "parameters": values} for name, values in effects]
    return ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "test", "effects": listed})


def test_a_sine_on_a_linear_wall_is_its_closed_form() -> None:
    found = simulate(model(("mass_damper_spring", WALL)), QUIET)
    t = found["time_s"]
    assert len(t) == 3001
    w = 2 * pi * 0.5
    x, v, a = 0.015 * (1 - np.cos(w * t)), 0.015 * w * np.sin(w * t), 0.015 * w * w * np.cos(w * t)
    np.testing.assert_allclose(found["position_m"], x, atol=1e-15)
    np.testing.assert_allclose(found["force_n"], 0.05 * a + 0.8 * v + 8.0 * x, atol=1e-12)
    steps = simulate(model(), replace(QUIET, encoder_step_m=1e-5))["position_m"] / 1e-5
    np.testing.assert_allclose(steps, np.round(x / 1e-5), atol=1e-6)


def test_the_physics_runs_faster_than_the_recording() -> None:
    friction = model(
        ("presliding_hysteresis", {"force_n": 0.08, "stiffness_n_m": 250.0}),
        ("stress_relaxation", {"stiffness_n_m": 6.0, "time_constant_s": 0.1}),
        ("sensor_lag", {"time_constant_s": 0.01}),
    )
    fine = simulate(friction, replace(QUIET, rate_hz=10_000.0))
    for every, rate_hz in ((10, 1000.0), (500, 20.0)):
        coarse = simulate(friction, replace(QUIET, rate_hz=rate_hz))
        np.testing.assert_allclose(coarse["time_s"], fine["time_s"][::every], atol=1e-12)
        np.testing.assert_allclose(coarse["force_n"], fine["force_n"][::every], atol=1e-9)


def test_the_position_is_that_of_the_stage_in_front_of_the_play() -> None:
    spring = {"mass_kg": 0.0, "damping_n_s_m": 0.0, "stiffness_n_m": 8.0}
    found = simulate(model(("backlash", {"width_m": 0.004}), ("mass_damper_spring", spring)), QUIET)
    gap = found["position_m"] - found["force_n"] / 8.0
    assert np.ptp(found["position_m"]) == pytest.approx(0.03)
    assert (float(gap.min()), float(gap.max())) == pytest.approx((-0.002, 0.002), abs=1e-9)


RANDOM = np.random.default_rng(3)


@pytest.mark.parametrize(
    "motion", [Hand(0.01, 0.04, 20.0, RANDOM), multisine(0.01, 0.04, RANDOM), sine(0.01, 0.04, 0.7)]
)
def test_velocity_and_acceleration_are_derivatives_within_the_depth(motion: MotionSource) -> None:
    t = np.arange(200_000, dtype=np.float64) * 1e-4
    x, v, a = motion.at(t)
    np.testing.assert_allclose(np.gradient(x, t)[1:-1], v[1:-1], atol=2e-5)
    np.testing.assert_allclose(np.gradient(v, t)[1:-1], a[1:-1], atol=2e-2)
    assert x.min() >= 0.0095 and x.max() <= 0.0505
    assert np.ptp(x) > 0.02
    np.testing.assert_array_equal(np.concatenate([motion.at(t[:777])[0], motion.at(t[777:])[0]]), x)


def test_a_hand_dwells_and_varies_speed_and_depth() -> None:
    t = np.arange(60_000, dtype=np.float64) * 1e-3
    x, v, _ = Hand(0.0, 0.03, 60.0, np.random.default_rng(1)).at(t)
    inward = (v[:-1] > 0.002) & (v[1:] <= 0.002)
    depths = [float(part.max()) for part in np.split(x, np.flatnonzero(inward)) if len(part) > 500]
    assert np.std(depths) > 0.001
    assert np.mean(np.abs(v) < 0.01) > 0.2


def test_seeds_repeat_and_differ() -> None:
    options = replace(QUIET, motion="hand", noise_n=0.002)
    wall = model(("mass_damper_spring", WALL))
    first, again, other = (simulate(wall, replace(options, seed=seed)) for seed in (1, 1, 2))
    for name in ("position_m", "force_n"):
        np.testing.assert_array_equal(first[name], again[name])
        assert not np.array_equal(first[name], other[name])


def test_conversion_sees_the_noise_and_a_lag_does_not() -> None:
    spikes = {"rate_hz": 5.0, "amplitude_n": 5.0}
    sensors = model(("sensor_quantisation", {"step_n": 0.01}), ("sensor_lag", {"time_constant_s": 0.2}))
    found = simulate(sensors, replace(QUIET, noise_n=0.02))["force_n"]
    np.testing.assert_allclose(found / 0.01, np.round(found / 0.01), atol=1e-6)
    assert np.std(found) == pytest.approx(0.02, rel=0.1)
    slow = simulate(model(("sensor_spikes", spikes)), replace(QUIET, rate_hz=50.0, duration_s=40.0))
    assert 150 < np.count_nonzero(slow["force_n"]) < 250


def test_a_recorded_motion_is_followed_behind_its_low_pass() -> None:
    t = 7.0 + np.arange(3000, dtype=np.float64) * 2e-3
    recorded = Recording("made up", t, 0.01 * np.sin(2 * pi * 0.8 * t), None, "made up")
    motion = FollowedRecording(recorded, slice(0, 3000))
    fine = np.arange(7.0, 12.9, 1e-4)
    x, v, _ = motion.at(fine)
    late_s = 2.0 / (2.0 * pi * SMOOTHING_HZ)
    np.testing.assert_allclose(x[5000:], 0.01 * np.sin(2 * pi * 0.8 * (fine[5000:] - late_s)), atol=2e-5)
    np.testing.assert_allclose(np.gradient(x, fine)[5000:], v[5000:], atol=1e-4)


def test_a_gap_in_a_recorded_motion_is_a_new_contact(tmp_path: Path) -> None:
    time_s = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(5.0, 7.0, 0.01)])
    ramp = np.concatenate([np.full(200, 0.01), np.full(200, 0.03)])
    ramp[100:200] = 0.02
    rows = "".join(f"{t!r},{x!r}\n" for t, x in zip(time_s.tolist(), ramp.tolist(), strict=True))
    path = tmp_path / "gap.csv"
    path.write_text("time_s,position_m\n" + rows)
    branch = model(("stress_relaxation", {"stiffness_n_m": 10.0, "time_constant_s": 50.0}))
    options = replace(QUIET, motion=str(path), duration_s=None)
    found = simulate(branch, options)
    np.testing.assert_array_equal(found["time_s"], time_s)
    assert found["force_n"][150] == pytest.approx(10.0 * 0.01, rel=0.02)
    np.testing.assert_array_equal(found["force_n"][200:], 0.0)
    even = simulate(branch, replace(options, rate_hz=250.0, duration_s=6.0))["time_s"]
    assert np.sum(even < 2.0) == 498
    assert (float(even[-1]), float(np.median(np.diff(even)))) == pytest.approx((6.0, 0.004))


def test_a_force_that_is_not_finite_is_refused() -> None:
    steep = model(("stiffening", {"cubic_n_m3": 1e12}), ("quadratic_drag", {"drag_n_s2_m2": 1e9}))
    endless = Recording("far", np.array([0.0, 1.0]), np.array([0.0, 1e200]), None, "far")
    piece = MotionPiece(FollowedRecording(endless, slice(0, 2)), np.array([0.0, 0.01]))
    with pytest.raises(ConfigurationError, match="expected a finite force"):
        integrate(steep, [piece], lambda _: None)
