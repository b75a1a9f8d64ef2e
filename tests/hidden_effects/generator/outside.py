"""Effects that no name of the vocabulary stands for: the honest answer is `unexplained`."""

from collections.abc import Callable
from math import pi

import numpy as np

from tests.hidden_effects.generator.motion import log_uniform
from tests.hidden_effects.generator.parts import Draw, Form, Place, Scene, Signal, Values, added, proportional
from tests.hidden_effects.generator.scan import Array

Force = Callable[[Signal, Values], Array]
_FORMS: list[Form] = []


def _outside(draw: Draw, inserted: bool | None = None) -> Callable[[Force], Force]:
    """Makes a form of a force, which has the function's name and is scaled by its `size`."""

    def register(force: Force) -> Force:
        scale = proportional("size")
        name = force.__name__
        _FORMS.append(Form(name, "outside", Place.FORCE, draw, added(force), scale, inserted=inserted))
        return force

    return register


def _spread(values: Array) -> float:
    return float(np.std(values))


def _seed(rng: np.random.Generator) -> float:
    return float(rng.integers(1, 2**31))


@_outside(lambda rng, scene: {"size": 0.05, "lead_m": _spread(scene.motion.x) * rng.uniform(0.25, 0.7)})
def position_ripple(signal: Signal, values: Values) -> Array:
    """Ball screw: periodic in position, with a second harmonic."""
    angle = 2.0 * pi * signal.x / values["lead_m"]
    return values["size"] * (np.sin(angle) + 0.4 * np.sin(2.0 * angle + 1.0))


@_outside(lambda rng, scene: {"size": 0.05, "scale": _spread(scene.motion.a) * rng.uniform(0.03, 0.15)})
def acceleration_sign(signal: Signal, values: Values) -> Array:
    return values["size"] * np.tanh(signal.a / values["scale"])


def _draw_wandering(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    return {"size": 0.05, "seed": _seed(rng), "period_s": scene.duration_s / rng.uniform(3, 9)}


def _wandering(signal: Signal, values: Values) -> Array:
    """A smooth random function of time of unit size, with the period of its fastest part."""
    rng = np.random.default_rng(int(values["seed"]))
    count = 12
    frequencies = rng.uniform(0.15, 1.0, count) / values["period_s"]
    phases = rng.uniform(0.0, 2.0 * pi, count)
    waves = np.zeros_like(signal.t)
    for frequency, phase in zip(frequencies, phases, strict=True):
        waves += np.sin(2.0 * pi * frequency * signal.t + phase)
    return np.asarray(waves * np.sqrt(2.0 / count))


@_outside(_draw_wandering)
def wandering_friction(signal: Signal, values: Values) -> Array:
    """Friction whose level comes and goes and changes its sign: a memory that time rewrites."""
    return values["size"] * _wandering(signal, values) * np.tanh(signal.v / 2e-5)


@_outside(_draw_wandering)
def temperature_wander(signal: Signal, values: Values) -> Array:
    """Zero that wanders up and down several times."""
    return values["size"] * _wandering(signal, values)


@_outside(_draw_wandering)
def gain_drift(signal: Signal, values: Values) -> Array:
    return values["size"] * _wandering(signal, values) * signal.base.force(signal.x, signal.v, signal.a)


def _lorenz(state: Array) -> Array:
    x, y, z = state
    return np.array([10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z])


@_outside(lambda rng, _: {"size": 0.01, "start": rng.uniform(5.0, 15.0), "speed": log_uniform(rng, 0.7, 2.5)})
def chaos(signal: Signal, values: Values) -> Array:
    """The first coordinate of Lorenz' attractor (1963), Runge-Kutta at 5 ms of its own time."""
    step = 5e-3
    span = float(signal.t[-1] - signal.t[0]) * values["speed"]
    state, first = np.array([values["start"], 1.0, 20.0]), []
    for _ in range(int(span / step) + 2):
        first.append(state[0])
        k1 = _lorenz(state)
        k2 = _lorenz(state + 0.5 * step * k1)
        k3 = _lorenz(state + 0.5 * step * k2)
        state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + _lorenz(state + step * k3))
    own = (signal.t - signal.t[0]) * values["speed"]
    return np.asarray(values["size"] * np.interp(own, step * np.arange(len(first)), np.array(first)))


@_outside(lambda rng, _: {"size": 10.0 if rng.random() < 0.5 else -10.0}, inserted=False)
def one_way_spring(signal: Signal, values: Values) -> Array:
    """Stiffer in one direction of motion, on both sides of zero."""
    return values["size"] * signal.x * (signal.v > 0.0)


@_outside(lambda *_: {"size": 0.01})
def jerk(signal: Signal, values: Values) -> Array:
    return values["size"] * np.gradient(signal.a, signal.t)


@_outside(
    lambda rng, scene: {
        "size": 50.0, "length_m": _spread(scene.motion.x) * rng.uniform(0.15, 0.4), "seed": _seed(rng),
    }
)  # fmt: skip
def stick_slip(signal: Signal, values: Values) -> Array:
    """A spring that is dragged along and lets go completely at random elongations."""
    rng = np.random.default_rng(int(values["seed"]))
    every = max(1, round(1e-3 / signal.step_s))
    x = signal.x[::every]
    held, limit, pulls = x[0], values["length_m"], np.zeros_like(x)
    for n, now in enumerate(x.tolist()):
        if abs(now - held) > limit:
            held, limit = now, values["length_m"] * rng.uniform(0.2, 1.8)
        pulls[n] = now - held
    return values["size"] * np.interp(signal.t, signal.t[::every], pulls)


@_outside(
    lambda rng, scene: {
        "size": 0.05, "frequency_hz": log_uniform(rng, 4.0, 9.0),
        "per_m": rng.uniform(0.5, 0.8) / float(np.max(np.abs(scene.motion.x))),
        "damping_ratio": rng.uniform(0.03, 0.1),
    }
)  # fmt: skip
def position_dependent_resonance(signal: Signal, values: Values) -> Array:
    """A flexible mass whose frequency depends on the position, semi-implicit Euler at 2 kHz."""
    every = max(1, round(5e-4 / signal.step_s))
    omega = 2.0 * pi * values["frequency_hz"] * (1.0 + values["per_m"] * signal.x[::every])
    pull, step = -signal.a[::every], every * signal.step_s
    q, rate, forces = 0.0, 0.0, np.zeros_like(pull)
    for n, (w, drive) in enumerate(zip(omega.tolist(), pull.tolist(), strict=True)):
        forces[n] = w * w * q + 2.0 * values["damping_ratio"] * w * rate
        rate += step * (drive - forces[n])
        q += step * rate
    return -values["size"] * np.interp(signal.t, signal.t[::every], forces)


@_outside(
    lambda rng, scene: {
        "size": 0.1, "centre_m": float(rng.uniform(*np.percentile(scene.motion.x, (30, 70)))),
        "width_m": _spread(scene.motion.x) * rng.uniform(0.1, 0.25),
    }
)  # fmt: skip
def local_bump(signal: Signal, values: Values) -> Array:
    return values["size"] * np.exp(-0.5 * ((signal.x - values["centre_m"]) / values["width_m"]) ** 2)


@_outside(
    lambda rng, scene: {"size": 1.0, "neutral_m": _spread(scene.motion.x) * rng.uniform(0.5, 1.0)},
    inserted=False,
)
def van_der_pol(signal: Signal, values: Values) -> Array:
    """Damping that is negative near zero."""
    return values["size"] * ((signal.x / values["neutral_m"]) ** 2 - 1.0) * signal.v


def _draw_chirp(rng: np.random.Generator, scene: Scene) -> dict[str, float]:
    slow = rng.uniform(0.3, 0.8)
    return {"size": 0.05, "slow_hz": slow, "rate_hz_s": slow * rng.uniform(2.0, 5.0) / scene.duration_s}


@_outside(_draw_chirp)
def chirp(signal: Signal, values: Values) -> Array:
    turns = values["slow_hz"] * signal.t + 0.5 * values["rate_hz_s"] * signal.t**2
    return values["size"] * np.sin(2.0 * pi * turns)


@_outside(lambda rng, _: {"size": 10.0, "frequency_hz": rng.uniform(0.3, 2.0), "phase": rng.uniform(-pi, pi)})
def breathing_spring(signal: Signal, values: Values) -> Array:
    angle = 2.0 * pi * values["frequency_hz"] * signal.t + values["phase"]
    return values["size"] * signal.x * np.sin(angle)


@_outside(lambda rng, scene: {"size": 0.05, "speed_m_s": _spread(scene.motion.v) * rng.uniform(0.5, 1.0)})
def velocity_ripple(signal: Signal, values: Values) -> Array:
    """Cogging: periodic in velocity."""
    return values["size"] * np.sin(2.0 * pi * signal.v / values["speed_m_s"])


OUTSIDE: tuple[Form, ...] = tuple(_FORMS)
