"""What comes without motion, and the way from the force to its reading: bias, pulsation, mains_hum,
sensor_drift, unmodelled_resonance, time_delay, sensor_lag, sensor_saturation, sensor_quantisation,
sensor_spikes.
"""

from math import pi

import numpy as np

from tests.hidden_effects.generator.motion import log_uniform
from tests.hidden_effects.generator.parts import (
    Form,
    Place,
    Scene,
    Signal,
    Values,
    added,
    inverse,
    proportional,
)  # fmt: skip
from tests.hidden_effects.generator.scan import Array, one_pole


def _harmonics(rng: np.random.Generator, count: int, strongest: float) -> dict[str, float]:
    drawn = {
        "phase_1": rng.uniform(-pi, pi),
        "phase_2": rng.uniform(-pi, pi),
        "phase_3": rng.uniform(-pi, pi),
    }
    ratios = [rng.uniform(0.15, strongest) / order if order < count + 1 else 0.0 for order in (1, 2)]
    return {**drawn, "ratio_2": ratios[0] if count > 1 else 0.0, "ratio_3": ratios[1] if count > 2 else 0.0}


def _draw_pulsation(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    heart = rng.random() < 0.7
    frequency = rng.uniform(0.8, 2.5) if heart else rng.uniform(0.15, 0.5)
    return {"frequency_hz": frequency, "amplitude_n": 0.05, **_harmonics(rng, int(rng.integers(1, 4)), 0.7)}


def _draw_hum(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    mains = 50.0 if rng.random() < 0.6 else 60.0
    frequency = mains + rng.uniform(-0.03, 0.03)
    return {"frequency_hz": frequency, "amplitude_n": 0.05, **_harmonics(rng, int(rng.integers(1, 4)), 0.4)}


def _periodic(signal: Signal, values: Values) -> Array:
    """Amplitude of the fundamental; harmonics relative to it."""
    angle = 2.0 * pi * values["frequency_hz"] * signal.t
    sines = np.sin(angle + values["phase_1"])
    for order in (2, 3):
        sines += values[f"ratio_{order}"] * np.sin(order * angle + values[f"phase_{order}"])
    return values["amplitude_n"] * sines


def _draw_drift(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    sign = 1.0 if rng.random() < 0.5 else -1.0
    return {
        "rate_n_s": sign * 0.05 / scene.duration_s,
        "settling_s": scene.duration_s * rng.uniform(0.3, 0.8),
    }


def _creep(signal: Signal, values: Values) -> Array:
    """Creep that slows down; `rate_n_s` is its first rate."""
    settling = values["settling_s"]
    return values["rate_n_s"] * settling * -np.expm1(-np.maximum(signal.t, 0.0) / settling)


def _draw_mode(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    """Within what the motion excites: below its fastest part."""
    return {
        "mass_kg": 0.1,
        "frequency_hz": log_uniform(rng, 3.0, 14.0),
        "damping_ratio": log_uniform(rng, 0.02, 0.2),
    }


def modal(drive: Array, step_s: float, frequency_hz: float, damping_ratio: float) -> tuple[Array, Array]:
    """(q, dq/dt) of `q'' + 2 d w q' + w^2 q = drive`, exact for a drive constant over a step."""
    omega = 2.0 * pi * frequency_hz
    damped = omega * np.sqrt(1.0 - damping_ratio**2)
    pole = complex(-damping_ratio * omega, damped)
    mean = 0.5 * (drive + np.concatenate((drive[:1], drive[:-1])))
    turn = np.exp(pole * step_s)
    y = one_pole(turn, mean * ((turn - 1.0) / pole))
    return y.imag / damped, (pole * y).imag / damped


def _flexible_mass(signal: Signal, values: Values) -> Array:
    """A second mass behind a spring: what it pulls with while the stage accelerates."""
    omega = 2.0 * pi * values["frequency_hz"]
    q, rate = modal(-signal.a, signal.step_s, values["frequency_hz"], values["damping_ratio"])
    return -values["mass_kg"] * (omega * omega * q + 2.0 * values["damping_ratio"] * omega * rate)


def _fixture(signal: Signal, values: Values) -> None:
    """The load cell's own mode between force and reading."""
    omega = 2.0 * pi * values["frequency_hz"]
    start = signal.force[0]
    q, _ = modal(signal.force - start, signal.step_s, values["frequency_hz"], values["damping_ratio"])
    signal.force = start + omega * omega * q


def _delay(signal: Signal, values: Values) -> None:
    signal.force = np.interp(signal.t - values["delay_s"], signal.t, signal.force)


def _lag(signal: Signal, values: Values) -> None:
    """`T dy/dt = f - y` by the trapezoidal rule, settled at the start."""
    half = 0.5 * signal.step_s / values["time_constant_s"]
    start = signal.force[0]
    drive = signal.force - start
    mean = 0.5 * (drive + np.concatenate((drive[:1], drive[:-1])))
    signal.force = start + one_pole((1.0 - half) / (1.0 + half), 2.0 * half / (1.0 + half) * mean)


def _clip(signal: Signal, values: Values) -> None:
    signal.force = np.clip(signal.force, -values["limit_n"], values["limit_n"])


def _comb(signal: Signal, values: Values) -> None:
    signal.force = values["step_n"] * np.floor(signal.force / values["step_n"] + 0.5)


def _draw_spikes(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    """Below one sample in fifty; fewer would be a burst rather than isolated outliers."""
    fastest = min(5.0, scene.rate_hz / 50.0)
    rate = log_uniform(rng, 0.5 if fastest > 0.5 else 0.5 * fastest, fastest)
    return {"rate_hz": rate, "amplitude_n": 1.0, "train": float(rng.integers(1, 2**31))}


def _spikes(signal: Signal, values: Values) -> None:
    """Single samples, either sign, within 30 % of the amplitude."""
    rng = np.random.default_rng(int(values["train"]))
    hit = rng.random(len(signal.t)) < values["rate_hz"] * float(np.median(np.diff(signal.t)))
    size = rng.uniform(0.7, 1.3, len(hit)) * np.where(rng.random(len(hit)) < 0.5, -1.0, 1.0)
    signal.force = signal.force + values["amplitude_n"] * hit * size


CHAIN = (
    Form("bias", "constant", Place.FORCE,
         lambda rng, scene: {"force_n": 0.05 if rng.random() < 0.5 else -0.05},
         added(lambda signal, values: np.full_like(signal.t, values["force_n"])), proportional("force_n"),
         ("force_n",)),
    Form("pulsation", "heart or breath", Place.FORCE, _draw_pulsation, added(_periodic),
         proportional("amplitude_n"), ("frequency_hz", "amplitude_n")),
    Form("mains_hum", "50 or 60 Hz", Place.CHAIN, _draw_hum, added(_periodic), proportional("amplitude_n"),
         ("frequency_hz", "amplitude_n"), shares=(0.08, 0.3), lowest_rate_hz=300.0),
    Form("sensor_drift", "ramp", Place.CHAIN, _draw_drift,
         added(lambda signal, values: values["rate_n_s"] * signal.t), proportional("rate_n_s"),
         ("rate_n_s",)),
    Form("sensor_drift", "creep", Place.CHAIN, _draw_drift, added(_creep), proportional("rate_n_s")),
    Form("unmodelled_resonance", "flexible mass", Place.FORCE, _draw_mode, added(_flexible_mass),
         proportional("mass_kg"), ("frequency_hz", "damping_ratio"), lowest_rate_hz=100.0),
    Form("unmodelled_resonance", "fixture", Place.CHAIN,
         lambda rng, scene: {"frequency_hz": 8.0, "damping_ratio": log_uniform(rng, 0.03, 0.2)}, _fixture,
         inverse("frequency_hz"), ("frequency_hz", "damping_ratio"), linear=False, lowest_rate_hz=100.0),
    Form("time_delay", "delay", Place.CHAIN, lambda rng, scene: {"delay_s": rng.uniform(0.02, 0.08)}, _delay,
         proportional("delay_s"), ("delay_s",), own_size=True),
    Form("sensor_lag", "first order", Place.CHAIN,
         lambda rng, scene: {"time_constant_s": rng.uniform(0.02, 0.08)}, _lag,
         proportional("time_constant_s"), ("time_constant_s",), own_size=True),
    Form("sensor_saturation", "symmetric", Place.READING,
         lambda rng, scene: {"limit_n": 0.8 * float(np.max(np.abs(scene.force)))}, _clip, inverse("limit_n"),
         ("limit_n",), linear=False, kinked=True),
    Form("sensor_quantisation", "mid-tread", Place.READING,
         lambda rng, scene: {"step_n": 0.3 * float(np.std(scene.force))}, _comb, proportional("step_n"),
         ("step_n",), linear=False, shares=(0.08, 0.25)),
    Form("sensor_spikes", "single samples", Place.READING, _draw_spikes, _spikes, proportional("amplitude_n"),
         ("rate_hz", "amplitude_n")),
)  # fmt: skip
