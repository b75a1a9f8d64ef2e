"""How much of what is hidden remains when mass, damper, spring and offset are fitted again."""

import numpy as np

from tests.hidden_effects.generator.parts import Part
from tests.hidden_effects.generator.scan import Array
from tests.hidden_effects.generator.truth import Hidden, reading


def columns(hidden: Hidden, offset: bool = True) -> Array:
    """Acceleration, velocity, position and 1 at the record's instants, shape (samples, 4) or (samples, 3)."""
    stage, at = hidden.stage, hidden.time_s
    motion = [np.interp(at, stage.t, column) for column in (stage.a, stage.v, stage.x)]
    return np.stack([*motion, np.ones_like(at)] if offset else motion, axis=1)


def silent(hidden: Hidden, parts: tuple[Part, ...] | None = None) -> Array:
    """The reading without noise, with the hidden parts or others."""
    selected = hidden.truth.parts if parts is None else parts
    zero = np.zeros_like(hidden.time_s)
    return reading(hidden.stage, hidden.truth.base, selected, hidden.time_s, zero)


def refitted(phi: Array, force: Array) -> Array:
    """What least squares on the columns leave of the force."""
    scale = np.linalg.norm(phi, axis=0)
    used = phi[:, scale > 0.0] / scale[scale > 0.0]
    theta = np.linalg.lstsq(used, force, rcond=1e-10)[0]
    return np.asarray(force - used @ theta)


def leftovers_n(hidden: Hidden) -> tuple[float, ...]:
    """rms in N of each hidden effect, the others known, after the fit; a bias is fitted without offset."""
    whole, left = silent(hidden), []
    for part in hidden.truth.parts:
        others = tuple(other for other in hidden.truth.parts if other is not part)
        phi = columns(hidden, offset=part.form.name != "bias")
        rest = refitted(phi, whole - silent(hidden, others) if others else whole)
        left.append(float(np.sqrt(np.mean(rest * rest))))
    return tuple(left)


def gain(hidden: Hidden) -> float:
    """1 - rms of the noise / rms of what mass, damper, spring and offset leave of the reading."""
    noise_n = noise_floor_n(hidden)
    left = refitted(columns(hidden), silent(hidden))
    return 1.0 - noise_n / float(np.hypot(noise_n, np.sqrt(np.mean(left * left))))


def noise_floor_n(hidden: Hidden) -> float:
    noise = hidden.truth.noise
    return float(np.hypot(noise.rms_n, noise.white_n))
