"""What a peer that chooses among columns is given, and how its choice is read.

Motion and force go through one Savitzky-Golay filter. What such a peer can not say (`unexplained`,
`not_separable`, effects with memory) it is not asked to say by other means.
"""

import numpy as np
from scipy.signal import savgol_filter

from forefeel.common.error_size import Floats
from tests.hidden_effects.answers import Answer, Interval, Measured

_COLUMNS = (
    ("", "mass_kg"), ("", "damping_n_s_m"), ("", "stiffness_n_m"),
    ("bias", "force_n"), ("coulomb_friction", "force_n"), ("quadratic_drag", "drag_n_s2_m2"),
    ("stiffening", "quadratic_n_m2"), ("stiffening", "cubic_n_m3"),
    ("hunt_crossley_damping", "damping_n_s_m2"), ("asymmetric_damping", "half_difference_n_s_m"),
    ("position_dependent_friction", "force_per_length_n_m"), ("sensor_drift", "rate_n_s"),
)  # fmt: skip
KNOWN = frozenset(name for name, _ in _COLUMNS if name)
CONSTANT = _COLUMNS.index(("bias", "force_n"))
_WINDOW_S = 0.06


def moves(measured: Measured) -> bool:
    return bool(np.std(measured.force_n) > 0.0 and np.ptp(measured.position_m) >= 1e-5)


def candidates(measured: Measured) -> tuple[Floats, Floats]:
    """Columns in the order of _COLUMNS and the force, filtered alike on an even grid."""
    rate_hz = 1.0 / float(np.median(np.diff(measured.time_s)))
    t = np.arange(measured.time_s[0], measured.time_s[-1], 1.0 / rate_hz)
    window = max(5, 2 * int(0.5 * _WINDOW_S * rate_hz) + 1)
    position = np.interp(t, measured.time_s, measured.position_m)
    x, v, a = (savgol_filter(position, window, 3, order, 1.0 / rate_hz) for order in (0, 1, 2))
    force = savgol_filter(np.interp(t, measured.time_s, measured.force_n), window, 3)
    inside, sense = np.maximum(x, 0.0), np.sign(v) * (np.abs(v) > 1e-4)
    columns = (a, v, x, np.ones_like(x), sense, v * np.abs(v), x**2, x**3)
    more = (inside * v, np.abs(v), inside * sense, t - t[0])
    return np.stack([*columns, *more], axis=1), force


def answer(sizes_n: Floats, values: Floats, seconds: float) -> Answer:
    """Every column with a coefficient names its effect; mass, damping, stiffness none.

    Args:
        sizes_n: std of what each column contributes, N. values: its coefficients in SI units.
    """
    explained: dict[str, float] = {}
    parameters: dict[str, dict[str, Interval]] = {}
    for (name, parameter), size_n, value in zip(_COLUMNS, sizes_n, values, strict=True):
        if name and size_n != 0.0:
            explained[name] = explained.get(name, 0.0) + abs(float(size_n))
            factor = 2.0 if parameter.startswith("half_") else 1.0
            found = factor * float(value)
            parameters.setdefault(name, {})[parameter.removeprefix("half_")] = (found, found, found)
    names = tuple(sorted(explained, key=lambda name: -explained[name]))
    return Answer("cause_found" if names else "nothing_missing", names, parameters, seconds=seconds)
