"""A model of a file on the own motion: what of it holds for another run, what this run has to tell anew.

The forces are made by formulas of this file.
"""

from collections.abc import Callable
from math import cos, exp, nan, pi, sin
from typing import Any

import numpy as np
import pytest

from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.estimation.identification import (
    ContactEstimate,
    ContactIdentifier,
    IdentificationSettings,
)
from forefeel.common.estimation.loaded import NOTHING, LoadedContact
from forefeel.common.estimation.transfer import SensorColumns, lasting

MS = 1_000_000
DELAY = 300
SPRING = {
    "effect": "mass_damper_spring",
    "parameters": {"mass_kg": 0.0, "damping_n_s_m": 0.8, "stiffness_n_m": 12.0},
}
Motion = tuple[float, float]
Force = Callable[[float, Motion], float]


def model(*effects: dict[str, Any]) -> ContactModel:
    return ContactModel.from_mapping({"schema": SCHEMA, "name": "loaded", "effects": [SPRING, *effects]})


def motion(t: float) -> Motion:
    """Position m and velocity m/s: two sines, 20 mm."""
    w1, w2 = 2 * pi * 0.45, 2 * pi * 1.7
    return 0.015 + 0.01 * sin(w1 * t) + 0.003 * sin(w2 * t), 0.01 * w1 * cos(w1 * t) + 0.003 * w2 * cos(
        w2 * t
    )


def spring(t: float, at: Motion) -> float:
    return 12.0 * at[0] + 0.8 * at[1]


def left(loaded: LoadedContact, force: Force, duration_s: float, after_s: float) -> np.ndarray[Any, Any]:
    """Errors of (identified, loaded) in N from `after_s` on; forces are 300 ms late."""
    errors = []
    for n in range(round(duration_s * 1000)):
        t = n * 1e-3
        if n >= DELAY:
            late = t - DELAY * 1e-3
            loaded.learn((n - DELAY) * MS, force(late, motion(late)))
        said = loaded.move(n * MS, *motion(t), None)
        if t > after_s:
            errors.append(np.array(said) - force(t, motion(t)))
    return np.array(errors)


def rms(errors: np.ndarray[Any, Any]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def test_what_belongs_to_its_run_is_left_out_and_a_bias_is_put_in() -> None:
    kept = lasting(
        model(
            {"effect": "bias", "parameters": {"force_n": 0.4}},
            {"effect": "coulomb_friction", "parameters": {"force_n": 0.1}},
            {"effect": "pulsation", "parameters": {"amplitude_n": 0.1}},
            {"effect": "sensor_lag", "parameters": {"time_constant_s": 0.02}},
            {"effect": "stiffness_change", "parameters": {"ratio": 2.0}},
        )
    )
    assert [e.effect for e in kept.effects] == [
        "mass_damper_spring",
        "coulomb_friction",
        "sensor_lag",
        "bias",
    ]
    assert kept.runtime().linear_values[0] == 0.0
    assert kept.runtime().linear_names[0] == "bias.force_n"


def test_the_columns_of_time_are_a_drift_and_the_known_frequencies() -> None:
    heart = {
        "frequency_hz": 1.25,
        "second_harmonic_ratio": 0.3,
        "third_harmonic_ratio": 0.01,
        "phase_rad": 1.0,
    }
    columns = SensorColumns(
        model(
            {"effect": "sensor_drift"}, {"effect": "pulsation", "parameters": heart}, {"effect": "mains_hum"}
        )
    )
    w = 2 * pi * 1.25 * 0.7
    expected = (0.7, sin(w), cos(w), sin(2 * w), cos(2 * w), sin(100 * pi * 0.7), cos(100 * pi * 0.7))
    assert columns.at(0.7) == pytest.approx(expected)
    assert len(columns) == 7
    assert len(SensorColumns(model())) == 0


def test_a_loaded_model_is_right_before_any_force_but_for_the_bias() -> None:
    loaded = LoadedContact(model(), 40.0)
    said = [loaded.move(n * MS, *motion(n * 1e-3), None).loaded_n for n in range(1000)]
    exact = [spring(0.0, motion(n * 1e-3)) for n in range(1000)]
    assert rms(np.array(said[100:]) - exact[100:]) < 2e-4


def test_the_bias_of_this_run_is_learned_at_once() -> None:
    errors = left(LoadedContact(model(), 40.0), lambda t, at: spring(t, at) + 0.3, 1.0, 0.6)
    assert rms(errors[:, 1]) < 0.01


def test_the_phase_of_a_heartbeat_is_learned_at_the_known_frequency() -> None:
    beat = {
        "effect": "pulsation",
        "parameters": {"amplitude_n": 0.2, "frequency_hz": 1.17, "phase_rad": -1.0},
    }
    force: Force = lambda t, at: spring(t, at) + 0.2 * sin(2 * pi * 1.17 * t + 2.0)  # noqa: E731
    assert rms(left(LoadedContact(model(beat), 40.0), force, 8.0, 4.0)[:, 1]) < 0.005
    assert rms(left(LoadedContact(model(), 40.0), force, 8.0, 4.0)[:, 1]) > 0.1


def test_another_stiffness_is_learned_within_seconds() -> None:
    force: Force = lambda t, at: 20.0 * at[0] + 0.8 * at[1]  # noqa: E731
    errors = left(LoadedContact(model(), 40.0), force, 20.0, 0.1)[:, 1]
    assert rms(errors[-5000:]) < 0.1 * rms(errors[:300])


def test_friction_turns_with_the_velocity_and_not_behind_its_filter() -> None:
    """Coulomb's force flips within 2 ms of the reversal; the plain filter at 40 Hz is 8 ms late."""
    loaded = LoadedContact(model({"effect": "coulomb_friction", "parameters": {"force_n": 0.1}}), 40.0)
    force: Force = lambda t, at: spring(t, at) + (0.1 if at[1] > 0 else -0.1)  # noqa: E731
    wrong = np.abs(left(loaded, force, 10.0, 2.0)[:, 1]) > 0.1
    reversals = np.count_nonzero(np.diff(np.sign([motion(2 + n * 1e-3)[1] for n in range(8000)])))
    assert np.count_nonzero(wrong) <= 2 * reversals


def test_a_lag_and_the_end_of_the_range_are_foretold() -> None:
    lagged, dt, tau = [spring(0.0, motion(0.0))], 1e-3, 0.05
    for n in range(1, 6000):
        now = spring(n * dt, motion(n * dt))
        lagged.append(now + (lagged[-1] - now) * exp(-dt / tau))
    force: Force = lambda t, at: min(0.25, lagged[round(t / dt)])  # noqa: E731
    chain = (
        {"effect": "sensor_lag", "parameters": {"time_constant_s": tau}},
        {"effect": "sensor_saturation", "parameters": {"limit_n": 0.25}},
    )
    known, plain = (left(LoadedContact(model(*effects), 40.0), force, 6.0, 3.0) for effects in (chain, ()))
    assert rms(known[:, 1]) < 0.002
    assert rms(plain[:, 1]) > 0.02
    assert known[:, 1].max() < 0.001, "never beyond the range"


def test_the_identified_form_has_the_parameters_of_the_estimate() -> None:
    loaded = LoadedContact(model(), 40.0)
    estimate = _estimate((0.1, 0.0, 0.8, 24.0))
    loaded.move(0, *motion(0.0), estimate)
    said = [loaded.move(n * MS, *motion(n * 1e-3), estimate) for n in range(1, 500)][-1]
    x, v = motion(0.499)
    assert said.identified_n == pytest.approx(0.1 + 24.0 * x + 0.8 * v, abs=2e-3)
    assert said.loaded_n == pytest.approx(12.0 * x + 0.8 * v, abs=2e-3)


@pytest.mark.parametrize(("stamp", "x", "v"), [(5, nan, 0.0), (5, 0.0, nan), (0, 0.0, 0.0), (500, 0.0, 0.0)])
def test_nothing_is_said_of_what_is_no_motion_or_follows_a_pause(stamp: int, x: float, v: float) -> None:
    loaded = LoadedContact(model(), 40.0)
    assert loaded.move(0, 0.0, 0.0, None) is NOTHING
    assert loaded.move(stamp * MS, x, v, None) is NOTHING
    assert np.isfinite(loaded.move((stamp + 1) * MS, 0.01, 0.0, None).loaded_n)


def test_forces_that_answer_no_command_or_are_no_number_teach_nothing() -> None:
    loaded = LoadedContact(model(), 40.0)
    for n in range(1000):
        loaded.move(n * MS, *motion(n * 1e-3), None)
        loaded.learn(n * MS + 1, 5.0)
        loaded.learn(n * MS, nan)
    at = motion(1.0)
    assert loaded.move(1000 * MS, *at, None).loaded_n == pytest.approx(spring(1.0, at), abs=2e-3)
    assert loaded.of_motion_n(77, 0.5) == 0.5


def test_what_is_a_matter_of_time_is_taken_from_a_force() -> None:
    drift = LoadedContact(model({"effect": "sensor_drift"}), 40.0)
    left(drift, lambda t, at: spring(t, at) + 0.05 * t, 20.0, 19.0)
    at = motion(19.5)
    assert drift.of_motion_n(19_500 * MS, spring(19.5, at) + 0.05 * 19.5) == pytest.approx(
        spring(19.5, at), abs=0.02
    )


def test_a_sensor_that_lags_lags_every_regressor_of_the_identification() -> None:
    """The spring is found behind a lag of 80 ms as it is, and only with the lag in the model."""
    dt, tau = 0.004, 0.08
    found = []
    for effects in (({"effect": "sensor_lag", "parameters": {"time_constant_s": tau}},), ()):
        identifier = ContactIdentifier(lasting(model(*effects)), IdentificationSettings(cutoff_hz=15.0))
        y = spring(0.0, motion(0.0))
        for n in range(5000):
            at = motion(n * dt)
            now = spring(n * dt, at)
            y = now + (y - now) * exp(-dt / tau)
            identifier.observe(round(n * dt * 1e9), at[0], y)
        found.append(dict(zip(identifier.names, identifier.estimate().values, strict=True)))
    assert found[0]["mass_damper_spring.stiffness_n_m"] == pytest.approx(12.0, rel=0.03)
    assert found[0]["mass_damper_spring.damping_n_s_m"] == pytest.approx(0.8, rel=0.1)
    assert found[1]["mass_damper_spring.damping_n_s_m"] < 0.4


def test_nothing_is_identified_from_readings_at_the_end_of_the_range() -> None:
    identifiers = [
        ContactIdentifier(lasting(model(*effects)), IdentificationSettings(cutoff_hz=15.0))
        for effects in (({"effect": "sensor_saturation", "parameters": {"limit_n": 0.2}},), ())
    ]
    for n in range(5000):
        at = motion(n * 0.004)
        for identifier in identifiers:
            identifier.observe(n * 4 * MS, at[0], min(0.2, spring(0.0, at)))
    known, plain = (dict(zip(i.names, i.estimate().values, strict=True)) for i in identifiers)
    assert known["mass_damper_spring.stiffness_n_m"] == pytest.approx(12.0, rel=0.05)
    assert plain["mass_damper_spring.stiffness_n_m"] < 10.0


def _estimate(values: tuple[float, ...]) -> ContactEstimate:
    names = lasting(model()).runtime().linear_names
    return ContactEstimate(names, values, (0.0,) * 4, True, 1, 1, 0, 0.0, 0.0, 0)
