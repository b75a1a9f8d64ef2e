"""Wall and fluid: stiffening, hunt_crossley_damping, quadratic_drag, asymmetric_damping, stress_relaxation,
contact_loss, stiffness_change.
"""

import numpy as np

from tests.hidden_effects.generator.motion import log_uniform
from tests.hidden_effects.generator.parts import Form, Place, Scene, Signal, Values, added, proportional
from tests.hidden_effects.generator.scan import Array, one_pole


def _draw_polynomial(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    reach = float(np.max(np.abs(scene.motion.x)))
    which = rng.integers(0, 3)
    quadratic = 0.0 if which == 1 else 0.1 / reach**2
    cubic = 0.0 if which == 0 else 0.1 / reach**3 * rng.uniform(0.5, 2.0)
    return {"quadratic_n_m2": quadratic, "cubic_n_m3": cubic}


def _polynomial(signal: Signal, values: Values) -> Array:
    return (values["quadratic_n_m2"] + values["cubic_n_m3"] * signal.x) * signal.x**2


def _draw_fung(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    reach = float(np.max(np.abs(scene.motion.x)))
    return {"level_n": 0.02, "length_m": reach * rng.uniform(0.25, 0.8)}


def _fung(signal: Signal, values: Values) -> Array:
    """`A (exp(x / L) - 1)`: exponential wall (Fung, Biomechanics, chapter 7)."""
    return values["level_n"] * np.expm1(signal.x / values["length_m"])


def _draw_asymmetric(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    """Forward minus backward coefficient; the base's damper is the smaller of the two."""
    return {"difference_n_s_m": 1.0 if rng.random() < 0.5 else -1.0}


def _asymmetric(signal: Signal, values: Values) -> Array:
    difference = values["difference_n_s_m"]
    return difference * (np.maximum(signal.v, 0.0) if difference > 0.0 else -np.minimum(signal.v, 0.0))


def _draw_two_branches(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    fast = log_uniform(rng, 0.08, 0.3)
    return {
        "fast_n_m": 10.0 * rng.uniform(0.7, 1.5), "fast_s": fast,
        "slow_n_m": 10.0, "slow_s": fast * rng.uniform(6.0, 15.0),
    }  # fmt: skip


def _maxwell(v: Array, step_s: float, time_constant_s: float) -> Array:
    """Elongation of the branch's spring, by the trapezoidal rule."""
    half = 0.5 * step_s / time_constant_s
    mean = 0.5 * (v + np.concatenate((v[:1], v[:-1])))
    return one_pole((1.0 - half) / (1.0 + half), mean * step_s / (1.0 + half))


def _two_branches(signal: Signal, values: Values) -> Array:
    fast = values["fast_n_m"] * _maxwell(signal.v, signal.step_s, values["fast_s"])
    return fast + values["slow_n_m"] * _maxwell(signal.v, signal.step_s, values["slow_s"])


def _draw_contact(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    """The scale changes how far above the record's lowest position the wall begins."""
    recorded = scene.motion.x[scene.motion.t >= 0.0]
    low, reach = float(np.min(recorded)), float(np.ptp(recorded))
    return {"low_m": low, "contact_position_m": low + 0.2 * reach}


def _scaled_contact(values: Values, factor: float) -> dict[str, float]:
    low = values["low_m"]
    return {"low_m": low, "contact_position_m": low + factor * (values["contact_position_m"] - low)}


def _contact(signal: Signal, values: Values) -> None:
    """Nothing at all before the wall; beyond it mass, damper and spring from the depth."""
    depth = signal.x - values["contact_position_m"]
    signal.force = (depth > 0.0) * signal.base.force(np.maximum(depth, 0.0), signal.v, signal.a)


def _contact_with_mass(signal: Signal, values: Values) -> None:
    """Damper and spring belong to the wall, the mass is always carried."""
    depth = signal.x - values["contact_position_m"]
    wall = signal.base.damping_n_s_m * signal.v + signal.base.stiffness_n_m * depth
    signal.force = signal.base.mass_kg * signal.a + (depth > 0.0) * wall


def _draw_change(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    ratio = rng.uniform(0.4, 0.75) if rng.random() < 0.5 else rng.uniform(1.3, 2.0)
    return {"time_s": scene.duration_s * rng.uniform(0.3, 0.7), "ratio": ratio}


def _scaled_change(values: Values, factor: float) -> dict[str, float]:
    """A spring can lose at most itself: what would need more becomes a stiffening."""
    gain = (values["ratio"] - 1.0) * factor
    return {"time_s": values["time_s"], "ratio": 1.0 + (abs(gain) if gain < -0.9 else gain)}


def _change(signal: Signal, values: Values) -> Array:
    after = signal.t >= values["time_s"]
    return (values["ratio"] - 1.0) * signal.base.stiffness_n_m * signal.x * after


WALL = (
    Form("stiffening", "polynomial", Place.FORCE, _draw_polynomial,
         added(_polynomial),
         proportional("quadratic_n_m2", "cubic_n_m3"), ("quadratic_n_m2", "cubic_n_m3")),
    Form("stiffening", "Fung", Place.FORCE, _draw_fung, added(_fung), proportional("level_n")),
    Form("hunt_crossley_damping", "x v", Place.FORCE, lambda rng, scene: {"damping_n_s_m2": 100.0},
         added(lambda signal, values: values["damping_n_s_m2"] * np.maximum(signal.x, 0.0) * signal.v),
         proportional("damping_n_s_m2"), ("damping_n_s_m2",), inserted=True),
    Form("quadratic_drag", "v |v|", Place.FORCE, lambda rng, scene: {"drag_n_s2_m2": 50.0},
         added(lambda signal, values: values["drag_n_s2_m2"] * signal.v * np.abs(signal.v)),
         proportional("drag_n_s2_m2"), ("drag_n_s2_m2",)),
    Form("asymmetric_damping", "two slopes", Place.FORCE, _draw_asymmetric, added(_asymmetric),
         proportional("difference_n_s_m"), ("difference_n_s_m",)),
    Form("stress_relaxation", "one branch", Place.FORCE,
         lambda rng, scene: {"stiffness_n_m": 10.0, "time_constant_s": log_uniform(rng, 0.15, 3.0)},
         added(lambda signal, values:
               values["stiffness_n_m"] * _maxwell(signal.v, signal.step_s, values["time_constant_s"])),
         proportional("stiffness_n_m"), ("stiffness_n_m", "time_constant_s")),
    Form("stress_relaxation", "two branches", Place.FORCE, _draw_two_branches, added(_two_branches),
         proportional("fast_n_m", "slow_n_m")),
    Form("contact_loss", "nothing before", Place.WALL, _draw_contact, _contact, _scaled_contact,
         ("contact_position_m",), linear=False, kinked=True, inserted=True),
    Form("contact_loss", "mass carried", Place.WALL, _draw_contact, _contact_with_mass, _scaled_contact,
         ("contact_position_m",), linear=False, kinked=True, inserted=True),
    Form("stiffness_change", "step", Place.FORCE, _draw_change, added(_change), _scaled_change,
         ("time_s", "ratio"), kinked=True),
)  # fmt: skip
