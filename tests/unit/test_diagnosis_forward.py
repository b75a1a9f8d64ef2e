"""The simulation of the position from the force: round trips through effects, a measured oscillator."""

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.causes.candidate import Shape
from forefeel.common.causes.presliding_hysteresis import PreslidingHysteresis
from forefeel.common.causes.stress_relaxation import StressRelaxation
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.tabular import load_recording
from forefeel.diagnosis.diagnose.analysis import analyse
from forefeel.diagnosis.diagnose.band import cutoff_hz, speed_band_m_s
from forefeel.diagnosis.diagnose.faults import clean
from forefeel.diagnosis.diagnose.forward import (
    Between,
    between_samples,
    drives,
    forward_rmse,
    refined,
    rmse_m,
    simulate,
)
from forefeel.diagnosis.diagnose.forward_model import ForwardModel, first_order_hold
from forefeel.diagnosis.diagnose.regression import RecordingRegression
from forefeel.diagnosis.diagnose.signals import Signals
from tests.unit.driven_samples import Body, broad_force, driven

RATE_HZ = 2000.0
MASS, DAMPING, STIFFNESS = 0.08, 1.2, 40.0
measured = pytest.mark.skipif(
    "FOREFEEL_DATA" not in os.environ, reason="FOREFEEL_DATA names no folder with recordings"
)


def _motion(seconds: float = 8.0) -> tuple[Floats, Floats, Floats, Floats]:
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    w, size = 2.0 * np.pi * np.array([0.37, 0.9, 2.3, 5.1]), np.array([6e-3, 2e-3, 1e-3, 2e-4])
    phase = np.outer(t, w) + np.array([0.3, 2.0, 4.0, 1.0])
    x, v, a = np.sin(phase) @ size, np.cos(phase) @ (size * w), -np.sin(phase) @ (size * w * w)
    return t, np.asarray(x), np.asarray(v), np.asarray(a)


def _model(name: str, shape: Shape, *coefficients: float) -> ForwardModel:
    theta = np.array([MASS, DAMPING, STIFFNESS, *coefficients, *shape])
    shapes = ((name, len(shape)),) if name else ()
    return ForwardModel(shapes, ("", "", "", *(name for _ in coefficients)), theta, 1e-5)


def _branch(t: Floats, x: Floats, v: Floats, a: Floats) -> Floats:
    effect = StressRelaxation(stiffness_n_m=25.0, time_constant_s=0.4)
    return np.asarray(effect.columns(t, x, v, a)[:, 0] * 25.0)


def _dahl(t: Floats, x: Floats, v: Floats, a: Floats) -> Floats:
    effect = PreslidingHysteresis(force_n=0.05, stiffness_n_m=0.05 / 4e-4)
    return np.asarray(effect.columns(t, x, v, a)[:, 0] * 0.05)


def _mode(t: Floats, x: Floats, v: Floats, a: Floats) -> Floats:
    w = 2.0 * np.pi * 9.0
    effect = UnmodelledResonance(
        stiffness_n_m=0.02 * w * w, damping_n_s_m=0.02 * 0.2 * w, frequency_hz=9.0, damping_ratio=0.1
    )
    return np.asarray(effect.columns(t, x, v, a) @ np.array(effect.linear_values))


Force = Callable[[Floats, Floats, Floats, Floats], Floats]
ROUND_TRIPS: dict[str, tuple[ForwardModel, Force]] = {
    "nothing": (_model("", ()), lambda t, x, v, a: 0.0 * x),
    "stiffening": (_model("stiffening", (), 900.0, 4e5), lambda t, x, v, a: 900.0 * x**2 + 4e5 * x**3),
    "hunt_crossley_damping": (
        _model("hunt_crossley_damping", (), 150.0), lambda t, x, v, a: 150.0 * np.maximum(x, 0.0) * v,
    ),
    "quadratic_drag": (_model("quadratic_drag", (), 30.0), lambda t, x, v, a: 30.0 * v * np.abs(v)),
    "asymmetric_damping": (_model("asymmetric_damping", (), 0.6), lambda t, x, v, a: 0.6 * np.abs(v)),
    "coulomb_friction": (
        _model("coulomb_friction:asymmetric", (), 0.05, 0.03),
        lambda t, x, v, a: np.where(v > 0.0, 0.05, -0.03),
    ),
    "stribeck_friction": (
        _model("stribeck_friction", (4e-3,), 0.03, 0.02),
        lambda t, x, v, a: np.sign(v) * (0.03 + 0.02 * np.exp(-((v / 4e-3) ** 2))),
    ),
    "position_dependent_friction": (
        _model("position_dependent_friction", (), 6.0),
        lambda t, x, v, a: 6.0 * np.maximum(x, 0.0) * np.sign(v),
    ),
    "presliding_hysteresis": (_model("presliding_hysteresis", (4e-4,), 0.05), _dahl),
    "stress_relaxation": (_model("stress_relaxation", (0.4,), 25.0, 0.0), _branch),
    "stiffness_change": (
        _model("stiffness_change", (3.1,), -15.0), lambda t, x, v, a: -15.0 * x * (t > 3.1),
    ),
    "unmodelled_resonance": (
        _model("unmodelled_resonance", (9.0, 0.1), 0.02, 0.02 * 0.2), _mode,
    ),
    "bias": (_model("bias", (), 0.07), lambda t, x, v, a: 0.07 + 0.0 * x),
    "pulsation": (
        _model("pulsation", (1.2,), 0.04, 0.0, 0.0, 0.0, 0.01, 0.0),
        lambda t, x, v, a: 0.04 * np.sin(2.4 * np.pi * t) + 0.01 * np.cos(4.8 * np.pi * t),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROUND_TRIPS)
def test_the_force_of_a_motion_gives_that_motion_back(name: str) -> None:
    model, extra = ROUND_TRIPS[name]
    t, x, v, a = _motion()
    force = MASS * a + DAMPING * v + STIFFNESS * x + extra(t, x, v, a)
    (drive,) = drives(Recording("made", t, x, force, "test"), force, 1.0, "straight")
    state = np.array([x[0], v[0]])
    off = simulate(model, drive, state) - x
    without = simulate(_model("", ()), drive, state) - x
    assert np.std(off) < 0.01 * np.std(x)
    if name != "nothing":
        assert np.std(off) < 0.1 * np.std(without) or np.mean(np.abs(off)) < 0.1 * np.mean(np.abs(without))


def test_a_stuck_body_stays_until_the_force_is_larger_than_its_friction() -> None:
    model = _model("coulomb_friction", (), 0.05)
    t = np.arange(4000) / RATE_HZ
    force = 0.03 * t  # breaks away at 1.67 s
    (drive,) = drives(Recording("made", t, 1e-3 * t, force, "test"), force, 1.0, "straight")
    x = simulate(model, drive, np.zeros(2))
    assert np.max(np.abs(x[t < 1.6])) < 2e-5
    assert x[-1] == pytest.approx((force[-1] - 0.05) / STIFFNESS, rel=0.15)


def test_a_driven_stick_slip_is_followed() -> None:
    """Against an integrator that shares nothing with it."""
    body = Body(MASS, DAMPING, STIFFNESS, 0.05)
    force = broad_force(np.random.default_rng(1), 6.0, 12.0, 0.12)
    recording = driven(body, force, RATE_HZ, 1, noise_n=0.0, noise_m=0.0)
    assert recording.force_n is not None
    (drive,) = drives(recording, recording.force_n, 1.0, "straight")
    model = _model("coulomb_friction", (), 0.05)
    off = simulate(model, drive) - drive.position_m
    assert np.std(off) < 0.03 * np.std(drive.position_m)


def test_output_error_finds_the_parameters_and_how_the_force_runs_between_samples() -> None:
    truth = _model("stiffening", (), 900.0, 4e6)
    rng = np.random.default_rng(2)
    f = np.repeat(rng.standard_normal(600), 4) * 0.3  # held for 2 ms
    t = np.arange(len(f)) / RATE_HZ
    (drive,) = drives(Recording("made", t, np.sin(t), f, "test"), f, 1.0, "held")
    x = simulate(truth, drive, np.zeros(2)) + 1e-6 * rng.standard_normal(len(f))
    recording = Recording("made", t, x, f, "test")
    start = truth.with_theta(truth.theta * np.array([1.03, 0.9, 0.97, 0.0, 1.3]))
    assert between_samples(start, recording, f, 1.0) == "held"
    found = refined(start, drives(recording, f, 1.0, "held"))
    assert found.theta[:3] == pytest.approx(truth.theta[:3], rel=5e-3)
    assert found.theta[4] == pytest.approx(4e6, rel=0.05)


def test_a_hold_of_first_order_is_exact_for_a_ramp() -> None:
    """x'' + x = t from rest: x = t - sin t."""
    phi, g0, g1 = first_order_hold(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([0.0, 1.0]), 0.7)
    z = np.zeros(2)
    for i in range(5):
        z = phi @ z + g0 * (0.7 * i) + g1 * (0.7 * (i + 1))
    assert z[0] == pytest.approx(3.5 - np.sin(3.5), abs=1e-12)


def test_no_forward_simulation_where_it_makes_no_sense() -> None:
    t, x, v, a = (column[::5] for column in _motion(12.0))
    noise = 2e-3 * np.random.default_rng(3).standard_normal(len(t))
    force = MASS * a + DAMPING * v + STIFFNESS * x + 0.06 * np.sign(v) + noise
    analysis = analyse(Recording("made", t, x, force, "test"))
    assert forward_rmse(analysis, driven=False) == {"before_m": None, "after_m": None}
    regression = analysis.regression
    assert ForwardModel.of(regression, regression.fit({"backlash": (1e-3,)})) is None
    assert ForwardModel.of(regression, regression.fit({"time_delay": (1e-2,)})) is None
    both = forward_rmse(analysis, driven=True)
    assert both["before_m"] is not None
    assert both["after_m"] is not None
    assert both["after_m"] < 0.3 * both["before_m"]


@cache
def _silverbox(name: str) -> Recording:
    return load_recording(Path(os.environ["FOREFEEL_DATA"]) / f"silverbox_{name}.csv")


def _arrow_mv(between: Between | None, *causes: str) -> float:
    """Error on the arrow in mV, of what was identified on the other record."""
    train, arrow = _silverbox("train"), _silverbox("test_arrow")
    assert train.force_n is not None
    assert arrow.force_n is not None
    cleaned = clean(train)
    signals = Signals(train, cleaned.force_n, cutoff_hz(train, cleaned.force_n), cleaned.clipped)
    reach_hz = min(2.0 * signals.cutoff_hz, signals.motion_reach_hz)
    regression = RecordingRegression(signals, speed_band_m_s(signals.even_m, signals.even_hz, reach_hz))
    found = ForwardModel.of(regression, regression.fit(dict.fromkeys(causes, ())))
    assert found is not None
    measured = train, cleaned.force_n, regression.sense
    between = between_samples(found, *measured) if between is None else between
    fitted = refined(found, drives(*measured, between), 30_000 if not causes else 10_000)
    error = rmse_m(fitted, drives(arrow, arrow.force_n, regression.sense, between))
    assert error is not None
    return 1e3 * error


@measured
def test_the_linear_model_is_as_far_off_on_the_arrow_as_published() -> None:
    assert _arrow_mv("straight") == pytest.approx(14.23, abs=0.03)


@measured
def test_stiffening_follows_the_arrow_within_a_millivolt() -> None:
    assert _arrow_mv(None, "stiffening") <= 1.0
