"""How far each single name of the vocabulary stays from what was hidden, in the drawn motion and noise.

The distance is that of the noise-free recording to the rival's best fit, whitened: the square is twice the
expected loss of log-likelihood. Below TOLD_APART the likelihood does not tell the rival from the truth.
Then the simpler of the two is the answer, so only a rival that is no richer makes the truth inseparable.
"""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from tests.hidden_effects.generator.chain import CHAIN, modal
from tests.hidden_effects.generator.friction import FRICTION
from tests.hidden_effects.generator.leftover import silent
from tests.hidden_effects.generator.motion import RICH, Motion
from tests.hidden_effects.generator.noise import whitened
from tests.hidden_effects.generator.parts import Base, Part, transmit
from tests.hidden_effects.generator.scan import Array
from tests.hidden_effects.generator.truth import Hidden
from tests.hidden_effects.generator.wall import WALL

TOLD_APART = 25.0
"""Five standard deviations of the log-likelihood ratio from the border."""

PARAMETERS = {
    "bias": 1, "coulomb_friction": 1, "stribeck_friction": 3, "presliding_hysteresis": 2, "backlash": 1,
    "stiffening": 2, "hunt_crossley_damping": 1, "quadratic_drag": 1, "asymmetric_damping": 1,
    "stress_relaxation": 2, "contact_loss": 1, "position_dependent_friction": 1, "stiffness_change": 2,
    "time_delay": 1, "sensor_lag": 1, "sensor_drift": 1, "sensor_saturation": 1, "sensor_quantisation": 1,
    "sensor_spikes": 2, "pulsation": 3, "mains_hum": 3, "unmodelled_resonance": 3,
}  # fmt: skip
"""Of each name in its simplest form, beside mass, damper and spring."""

_NEAR = 400.0
"""A family that comes so close on its grid is searched between its grid points."""
_SLOWEST_HZ = 200.0

Columns = Callable[[float], Array]
Family = tuple[str, Columns, Array]
"""Name, what it adds to (or puts in place of) mass, damper and spring, its shape parameter's grid."""


def distances(hidden: Hidden) -> dict[str, float]:
    """Squared distance of each rival name, the truth's own excluded."""
    every = max(1, int(hidden.truth.rate_hz / _SLOWEST_HZ))
    time_s = hidden.time_s[::every]
    rate_hz = hidden.truth.rate_hz / every

    def white(columns: Array) -> Array:
        return whitened(columns, hidden.truth.noise, rate_hz)

    target = white(silent(hidden)[::every])
    found: dict[str, float] = {}
    for name, columns, shapes in _families(hidden.stage.thinned(5), hidden.truth.duration_s):
        if name not in hidden.truth.names:
            best = _closest(partial(_loss, columns, hidden, time_s, white, target), shapes)
            found[name] = min(best, found.get(name, np.inf))
    return found


def inseparable(hidden: Hidden) -> tuple[str, ...]:
    """Single names, no richer than the truth, that the recording does not tell from it.

    Empty for pairs, for nothing, and for motions that separate nothing anyway. Of an effect outside of the
    vocabulary every name counts.
    """
    if len(hidden.truth.parts) != 1 or hidden.truth.motion not in RICH:
        return ()
    most = PARAMETERS.get(hidden.truth.names[0], max(PARAMETERS.values()))
    found = distances(hidden).items()
    return tuple(name for name, square in found if square < TOLD_APART and PARAMETERS[name] <= most)


def _at(columns: Array, hidden: Hidden, time_s: Array) -> Array:
    grid = hidden.stage.t[::5]
    return np.stack([np.interp(time_s, grid, column) for column in columns], axis=1)


def _loss(
    columns: Columns,
    hidden: Hidden,
    time_s: Array,
    white: Callable[[Array], Array],
    target: Array,
    shape: float,
) -> float:
    return _square(white(_at(columns(shape), hidden, time_s)), target)


def _square(phi: Array, target: Array) -> float:
    scale = np.linalg.norm(phi, axis=0)
    used = phi[:, scale > 0.0] / scale[scale > 0.0]
    gram = used.T @ used + 1e-12 * np.eye(used.shape[1])
    rest = target - used @ np.linalg.solve(gram, used.T @ target)
    return float(rest @ rest)


def _closest(square: Callable[[float], float], shapes: Array) -> float:
    """The least on the grid, or between its points when that is near."""
    values = [square(float(shape)) for shape in shapes]
    least = int(np.argmin(values))
    if len(shapes) == 1 or values[least] > _NEAR:
        return values[least]
    low, high = float(shapes[max(0, least - 1)]), float(shapes[min(len(shapes) - 1, least + 1)])
    return min(values[least], *(square(float(shape)) for shape in np.linspace(low, high, 15)))


def _form(name: str, number: int = 0) -> Callable[..., Part]:
    form = [form for form in (*FRICTION, *WALL, *CHAIN) if form.name == name][number]
    return lambda **values: Part(form, values)


def _families(motion: Motion, duration_s: float) -> Iterable[Family]:
    spring = np.stack((motion.a, motion.v, motion.x))
    one = np.ones_like(motion.x)
    none = np.ones(1)
    reach, size = float(np.ptp(motion.x)), float(np.max(np.abs(motion.x)))

    def extra(part: Part) -> Array:
        """What the part adds, with a base that does nothing."""
        return transmit(motion, Base(0.0, 0.0, 0.0), (part,))

    def through(part: Part) -> Array:
        """Mass, damper and spring behind the part."""
        units = (Base(1.0, 0.0, 0.0), Base(0.0, 1.0, 0.0), Base(0.0, 0.0, 1.0))
        return np.stack([transmit(motion, unit, (part,)) for unit in units])

    def plus(*columns: Array) -> Array:
        return np.vstack((spring, *columns))

    yield from _simple(motion, plus, one, none)
    blurs, speeds = np.geomspace(5e-6, 2e-4, 4), np.geomspace(5e-4, 2e-2, 8)
    coulomb, dahl, play = _form("coulomb_friction"), _form("presliding_hysteresis"), _form("backlash")
    yield "coulomb_friction", lambda w: plus(extra(coulomb(force_n=1.0, blur_m_s=w))), blurs
    yield "stribeck_friction", lambda w: plus(*_stribeck(motion, w)), speeds
    lengths = reach * np.geomspace(2e-3, 0.5, 10)
    yield "presliding_hysteresis", lambda w: plus(extra(dahl(force_n=1.0, stiffness_n_m=1.0 / w))), lengths
    yield "backlash", lambda w: through(play(width_m=w)), reach * np.geomspace(2e-3, 0.4, 10)
    yield "stiffening", lambda w: plus(np.expm1(motion.x / w)), size * np.geomspace(0.1, 2.0, 6)
    branch = _form("stress_relaxation")
    times = np.geomspace(0.02, 10.0, 12)
    yield "stress_relaxation", lambda w: plus(extra(branch(stiffness_n_m=1.0, time_constant_s=w))), times
    yield (
        "contact_loss",
        lambda w: _touching(motion, w),
        float(np.min(motion.x)) + reach * np.linspace(0.02, 0.9, 15),
    )
    change = np.linspace(0.1, 0.9, 17) * duration_s
    yield "stiffness_change", lambda w: plus(motion.x * (motion.t >= w)), change
    for ratio in (0.03, 0.1, 0.3):
        yield "unmodelled_resonance", partial(_with_mode, motion, ratio), np.geomspace(1.5, 40.0, 14)
    delay, lag = _form("time_delay"), _form("sensor_lag")
    late = np.geomspace(3e-4, 0.2, 16)
    yield "time_delay", lambda w: through(delay(delay_s=w)), late
    yield "sensor_lag", lambda w: through(lag(time_constant_s=w)), late


def _simple(motion: Motion, plus: Callable[..., Array], one: Array, none: Array) -> Iterable[Family]:
    """Without a shape parameter."""
    inside = np.maximum(motion.x, 0.0)
    yield "bias", lambda _: plus(one), none
    yield "sensor_drift", lambda _: plus(motion.t), none
    yield "stiffening", lambda _: plus(motion.x**2, motion.x**3), none
    yield "hunt_crossley_damping", lambda _: plus(inside * motion.v), none
    yield "quadratic_drag", lambda _: plus(motion.v * np.abs(motion.v)), none
    yield "asymmetric_damping", lambda _: plus(np.abs(motion.v)), none
    yield "position_dependent_friction", lambda _: plus(inside * np.tanh(motion.v / 2e-5)), none


def _stribeck(motion: Motion, speed: float) -> tuple[Array, Array]:
    sense = np.tanh(motion.v / 2e-5)
    return sense, sense * np.exp(-((motion.v / speed) ** 2))


def _touching(motion: Motion, position_m: float) -> Array:
    touches = motion.x > position_m
    return np.stack((motion.a, motion.a * touches, motion.v * touches, (motion.x - position_m) * touches))


def _with_mode(motion: Motion, damping_ratio: float, frequency_hz: float) -> Array:
    mode = modal(-motion.a, motion.step_s, frequency_hz, damping_ratio)
    return np.stack((motion.a, motion.v, motion.x, *mode))
