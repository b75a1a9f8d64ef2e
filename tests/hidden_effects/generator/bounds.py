"""The Cramer-Rao bound of each hidden parameter, from the generator's own model."""

from collections.abc import Callable
from math import sqrt

import numpy as np

from tests.hidden_effects.generator.leftover import silent
from tests.hidden_effects.generator.noise import whitened
from tests.hidden_effects.generator.parts import Base, Part, Place, transmit
from tests.hidden_effects.generator.scan import Array
from tests.hidden_effects.generator.truth import Hidden

_NOT_FITTED = frozenset({"blur_m_s", "low_m", "train", "seed"})
_SMOOTH, _KINKED = 1e-4, 5e-3


def relative_bounds(hidden: Hidden) -> dict[str, dict[str, float]]:
    """Lowest relative standard deviation of each judged parameter, by effect.

    Unknown beside them are mass, damping, stiffness, an offset and the values that are not judged. The level
    of a comb and the limit of flat tops are seen without noise: 0. Spikes are counted.
    """
    fitted = _fitted(hidden)
    jacobian = _jacobian(hidden, fitted)
    spread = _spread(jacobian)
    bounds: dict[str, dict[str, float]] = {}
    for part in hidden.truth.parts:
        if part.form.place is Place.READING:
            bounds[part.form.name] = _of_reading(hidden, part)
            continue
        own = {name: n for n, (owner, name) in enumerate(fitted) if owner is part}
        bounds[part.form.name] = {
            name: float(spread[own[name]]) / abs(part.values[name]) for name in part.parameters
        }
    return bounds


def _fitted(hidden: Hidden) -> list[tuple[Part, str]]:
    return [
        (part, name)
        for part in hidden.truth.parts
        if part.form.place is not Place.READING
        for name, value in part.values.items()
        if value != 0.0 and name not in _NOT_FITTED
    ]


def _jacobian(hidden: Hidden, fitted: list[tuple[Part, str]]) -> Array:
    """Whitened, clipped samples without weight; the last columns are m, b, k and the offset."""
    truth = hidden.truth
    passed = tuple(part for part in truth.parts if part.form.place is not Place.READING)

    def force(parts: tuple[Part, ...], base: Base) -> Array:
        return np.asarray(np.interp(hidden.time_s, hidden.stage.t, transmit(hidden.stage, base, parts)))

    slopes = [
        _slope(hidden, passed, part, name, lambda parts: force(parts, truth.base)) for part, name in fitted
    ]
    nothing = force(passed, Base(0.0, 0.0, 0.0))
    for unit in (Base(1.0, 0.0, 0.0), Base(0.0, 1.0, 0.0), Base(0.0, 0.0, 1.0)):
        slopes.append(force(passed, unit) - nothing)
    if "bias" not in truth.names:
        slopes.append(np.ones_like(hidden.time_s))
    white = whitened(np.stack(slopes, axis=1), truth.noise, truth.rate_hz, _rounding_n(hidden))
    return white * ~_clipped(hidden)[1:, None]


def _slope(
    hidden: Hidden, parts: tuple[Part, ...], part: Part, name: str, force: Callable[[tuple[Part, ...]], Array]
) -> Array:
    step = _step(hidden, part, name)
    value = part.values[name]

    def at(other: float) -> Array:
        return force(tuple(p.with_value(name, other) if p is part else p for p in parts))

    return np.asarray((at(value + step) - at(value - step)) / (2.0 * step))


def _step(hidden: Hidden, part: Part, name: str) -> float:
    """Wide enough to meet several samples where the force has kinks."""
    if name == "time_s":
        return 2.0 / hidden.truth.rate_hz
    if name == "contact_position_m":
        return 1e-3 * float(np.ptp(hidden.stage.x))
    return abs(part.values[name]) * (_KINKED if part.form.kinked else _SMOOTH)


def _spread(jacobian: Array) -> Array:
    """Standard deviations; infinite where the columns can not be told apart."""
    scale = np.linalg.norm(jacobian, axis=0)
    blind = scale == 0.0
    scale[blind] = 1.0
    _, singular, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    singular[singular < 1e-9 * singular[0]] = 1e-12
    deviation = np.sqrt(np.sum((directions / singular[:, None]) ** 2, axis=0)) / scale
    return np.asarray(np.where(blind, np.inf, deviation))


def _rounding_n(hidden: Hidden) -> float:
    """The rounding of a comb is noise to all others."""
    steps = [part.values["step_n"] for part in hidden.truth.parts if "step_n" in part.values]
    return sum(steps) / sqrt(12.0)


def _clipped(hidden: Hidden) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    limits = [part.values["limit_n"] for part in hidden.truth.parts if "limit_n" in part.values]
    silence = silent(hidden)
    return np.asarray(np.abs(silence) >= 0.999 * min(limits, default=np.inf))


def _of_reading(hidden: Hidden, part: Part) -> dict[str, float]:
    if part.form.name != "sensor_spikes":
        return dict.fromkeys(part.parameters, 0.0)
    count = max(1.0, part.values["rate_hz"] * hidden.truth.duration_s)
    one = sqrt(0.6**2 / 12.0 + (hidden.truth.noise.rms_n / part.values["amplitude_n"]) ** 2)
    return {"rate_hz": 1.0 / sqrt(count), "amplitude_n": one / sqrt(count)}
