"""Friction and play: coulomb_friction, stribeck_friction, presliding_hysteresis, backlash,
position_dependent_friction.
"""

import numpy as np

from tests.hidden_effects.generator.motion import log_uniform
from tests.hidden_effects.generator.parts import Form, Place, Scene, Signal, Values, added, proportional
from tests.hidden_effects.generator.scan import Array, play, varying_pole


def _sense(v: Array, blur_m_s: float) -> Array:
    """Direction, smooth within a few blurs of rest."""
    return np.tanh(v / blur_m_s)


def _blur(rng: np.random.Generator) -> float:
    return log_uniform(rng, 5e-6, 100e-6)


def _draw_asymmetric(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    ratio = rng.uniform(0.35, 0.8)
    weak, strong = 0.1 * ratio, 0.1
    forward, backward = (weak, strong) if rng.random() < 0.5 else (strong, weak)
    return {"forward_n": forward, "backward_n": backward, "blur_m_s": _blur(rng)}


def _asymmetric(signal: Signal, values: Values) -> Array:
    sense = _sense(signal.v, values["blur_m_s"])
    return values["forward_n"] * np.maximum(sense, 0.0) + values["backward_n"] * np.minimum(sense, 0.0)


def _draw_stribeck(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    return {
        "coulomb_n": 0.05,
        "static_n": 0.05 * rng.uniform(1.5, 3.0),
        "stribeck_velocity_m_s": rng.uniform(1.5e-3, 10e-3),
        "blur_m_s": log_uniform(rng, 5e-6, 30e-6),
    }


def _stribeck(signal: Signal, values: Values, exponent: float) -> Array:
    low, high = values["coulomb_n"], values["static_n"]
    falls = np.exp(-((np.abs(signal.v) / values["stribeck_velocity_m_s"]) ** exponent))
    return (low + (high - low) * falls) * _sense(signal.v, values["blur_m_s"])


def _draw_presliding(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    length_m = float(np.ptp(scene.motion.x)) * rng.uniform(0.03, 0.15)
    damping = scene.base.damping_n_s_m * rng.uniform(0.1, 0.5)
    return {"force_n": 0.05, "stiffness_n_m": 0.05 / length_m, "bristle_n_s_m": damping}


def _dahl(signal: Signal, values: Values) -> Array:
    """Dahl with exponent 1, by the trapezoidal rule."""
    half = 0.5 * np.abs(signal.v) * signal.step_s * values["stiffness_n_m"] / values["force_n"]
    sense = np.sign(signal.v)
    return values["force_n"] * varying_pole((1.0 - half) / (1.0 + half), 2.0 * half / (1.0 + half) * sense)


def _lugre(signal: Signal, values: Values) -> Array:
    """`dz/dt = v - s0 |v| z / Fc, f = s0 z + s1 dz/dt` (Canudas de Wit et al., IEEE TAC 40(3), 1995)."""
    s0, level = values["stiffness_n_m"], values["force_n"]
    rate = s0 * np.abs(signal.v) / level
    half = 0.5 * rate * signal.step_s
    z = varying_pole((1.0 - half) / (1.0 + half), signal.v * signal.step_s / (1.0 + half))
    return s0 * z + values["bristle_n_s_m"] * (signal.v - rate * z)


def _backlash(signal: Signal, values: Values) -> None:
    """The instrument rests while the stage crosses the gap."""
    y = play(signal.x, values["width_m"])
    carried = np.abs(signal.x - y) >= 0.5 * values["width_m"] * (1.0 - 1e-9)
    signal.x, signal.v, signal.a = y, signal.v * carried, signal.a * carried


FRICTION = (
    Form("coulomb_friction", "symmetric", Place.FORCE,
         lambda rng, scene: {"force_n": 0.05, "blur_m_s": _blur(rng)},
         added(lambda signal, values: values["force_n"] * _sense(signal.v, values["blur_m_s"])),
         proportional("force_n"), ("force_n",)),
    Form("coulomb_friction", "asymmetric", Place.FORCE, _draw_asymmetric, added(_asymmetric),
         proportional("forward_n", "backward_n"), ("forward_n", "backward_n")),
    Form("stribeck_friction", "gaussian", Place.FORCE, _draw_stribeck,
         added(lambda signal, values: _stribeck(signal, values, 2.0)), proportional("coulomb_n", "static_n"),
         ("coulomb_n", "static_n", "stribeck_velocity_m_s")),
    Form("stribeck_friction", "exponential", Place.FORCE, _draw_stribeck,
         added(lambda signal, values: _stribeck(signal, values, 1.0)), proportional("coulomb_n", "static_n"),
         ("coulomb_n", "static_n")),
    Form("presliding_hysteresis", "Dahl", Place.FORCE, _draw_presliding, added(_dahl),
         proportional("force_n", "stiffness_n_m"), ("force_n", "stiffness_n_m")),
    Form("presliding_hysteresis", "LuGre", Place.FORCE, _draw_presliding, added(_lugre),
         proportional("force_n", "stiffness_n_m", "bristle_n_s_m"), ("force_n", "stiffness_n_m")),
    Form("backlash", "play", Place.STAGE,
         lambda rng, scene: {"width_m": 0.05 * float(np.ptp(scene.motion.x))}, _backlash,
         proportional("width_m"), ("width_m",), linear=False, kinked=True, light=True),
    Form("position_dependent_friction", "capstan", Place.FORCE,
         lambda rng, scene: {"force_per_length_n_m": 3.0, "blur_m_s": _blur(rng)},
         added(lambda signal, values: values["force_per_length_n_m"] * np.maximum(signal.x, 0.0)
               * _sense(signal.v, values["blur_m_s"])),
         proportional("force_per_length_n_m"), ("force_per_length_n_m",), inserted=True),
)  # fmt: skip
