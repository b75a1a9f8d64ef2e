"""Named parameters with intervals from coefficients and shapes."""

from collections.abc import Callable

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose.candidates import CANDIDATES, Shape, base_name
from forefeel.diagnosis.diagnose.regression import BASE, ModelFit, RecordingRegression
from forefeel.diagnosis.diagnose.verdict import Interval

_DRAWS = 2000
_STEP = 1e-3
_BLOCKS = 32
_WIDER = 1.4
"""Calibrated: without it 88 % of the intervals hold the truth on recordings with a known one."""

_POSITIVE = frozenset({
    "stiffness_n_m", "second_stiffness_n_m", "time_constant_s", "second_time_constant_s", "width_m",
    "delay_s", "stribeck_velocity_m_s", "frequency_hz", "damping_ratio", "amplitude_n",
    "settling_s", "length_m",
})  # fmt: skip
"""What has no negative values in any cause: no interval reaches below zero."""

Values = dict[str, float]
Naming = Callable[[Floats, Shape, Floats, float], Values]
"""Coefficients of the cause, its shape, (m, b, k), stamp of the start -> parameters by name."""


def _two_levels(c: Floats, s: Shape, base: Floats, start: float) -> Values:
    return {"coulomb_n": c[0], "static_n": c[0] + c[1], "stribeck_velocity_m_s": s[0]}


def _pulse(c: Floats, s: Shape, base: Floats, start: float) -> Values:
    sizes = np.hypot(c[:3], c[3:])
    return {"frequency_hz": s[0], "amplitude_n": float(sizes.max())}


NAMINGS: dict[str, Naming] = {
    "bias": lambda c, s, b, t: {"force_n": c[0]},
    "coulomb_friction": lambda c, s, b, t: {"force_n": c[0]},
    "coulomb_friction:asymmetric": lambda c, s, b, t: {
        "force_n": 0.5 * (c[0] + c[1]), "forward_n": c[0], "backward_n": c[1],
    },
    "stribeck_friction": _two_levels,
    "stribeck_friction:exponential": _two_levels,
    "presliding_hysteresis": lambda c, s, b, t: {"force_n": c[0], "stiffness_n_m": c[0] / s[0]},
    "presliding_hysteresis:bristles": lambda c, s, b, t: {"force_n": c[0], "stiffness_n_m": c[0] / s[0]},
    "presliding_hysteresis:two": lambda c, s, b, t: {
        "force_n": c[0] + c[1], "stiffness_n_m": c[0] / s[0] + c[1] / s[1],
    },
    "backlash": lambda c, s, b, t: {"width_m": s[0]},
    "stiffening": lambda c, s, b, t: {"quadratic_n_m2": c[0], "cubic_n_m3": c[1]},
    "stiffening:exponential": lambda c, s, b, t: {
        "quadratic_n_m2": c[0] / (2.0 * s[0] ** 2), "cubic_n_m3": c[0] / (6.0 * s[0] ** 3),
        "exponential_n": c[0], "length_m": s[0],
    },
    "hunt_crossley_damping": lambda c, s, b, t: {"damping_n_s_m2": c[0]},
    "quadratic_drag": lambda c, s, b, t: {"drag_n_s2_m2": c[0]},
    "asymmetric_damping": lambda c, s, b, t: {"forward_n_s_m": b[1] + c[0], "backward_n_s_m": b[1] - c[0]},
    "stress_relaxation": lambda c, s, b, t: {"stiffness_n_m": c[0], "time_constant_s": s[0]},
    "stress_relaxation:two": lambda c, s, b, t: {
        "stiffness_n_m": c[0], "time_constant_s": s[0],
        "second_stiffness_n_m": c[2], "second_time_constant_s": s[1],
    },
    "contact_loss": lambda c, s, b, t: {"contact_position_m": s[0]},
    "contact_loss:carried": lambda c, s, b, t: {"contact_position_m": s[0]},
    "position_dependent_friction": lambda c, s, b, t: {"force_per_length_n_m": c[0]},
    "stiffness_change": lambda c, s, b, t: {
        "time_s": t + s[0], "ratio": 1.0 + c[0] / b[2] if b[2] else np.inf,
    },
    "time_delay": lambda c, s, b, t: {"delay_s": s[0]},
    "sensor_lag": lambda c, s, b, t: {"time_constant_s": s[0]},
    "sensor_drift": lambda c, s, b, t: {"rate_n_s": c[0]},
    "sensor_drift:creep": lambda c, s, b, t: {"rate_n_s": c[0] / s[0], "settling_s": s[0]},
    "pulsation": _pulse,
    "unmodelled_resonance": lambda c, s, b, t: {"frequency_hz": s[0], "damping_ratio": s[1]},
    "unmodelled_resonance:free": lambda c, s, b, t: {"frequency_hz": s[0], "damping_ratio": s[1]},
    "unmodelled_resonance:fixture": lambda c, s, b, t: {"frequency_hz": s[0], "damping_ratio": s[1]},
}  # fmt: skip


def intervals(
    regression: RecordingRegression,
    fit: ModelFit,
    elsewhere: tuple[RecordingRegression, ModelFit] | None = None,
) -> dict[str, dict[str, Interval]]:
    """95 % intervals of each cause's parameters, and of mass, damping, stiffness under "".

    Coefficients and shapes are drawn from the Gauss-Newton covariance `s^2 (J' J)^-1` on whitened data, J
    with the derivatives by the shapes; percentiles of the named parameters follow (propagation by draws). How
    far a value moves when the same model is fitted `elsewhere`, in another band, is added in square: what the
    choice of the band does is no less a doubt than the noise.
    """
    moved = None if elsewhere is None else _named_by(*elsewhere)
    return intervals_by(
        fit, _covariance(regression, fit), regression.signals.origin_s, regression.sense, moved
    )


def told(parameters: dict[str, Interval]) -> dict[str, Interval]:
    """Without a second element that can not be told from none."""
    second = parameters.get("second_stiffness_n_m")
    if second is None or second.low > 0.0:
        return parameters
    return {key: value for key, value in parameters.items() if not key.startswith("second_")}


def intervals_by(
    fit: ModelFit, covariance: Floats, start: float, sense: float, moved: dict[str, Values] | None = None
) -> dict[str, dict[str, Interval]]:
    """As `intervals`, by a known covariance of coefficients and shapes; `start`: stamp of the start.

    `moved`: the values elsewhere.
    """
    theta, sizes = _point(fit)
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal(
        theta, 0.5 * (covariance + covariance.T), size=_DRAWS, method="eigh", check_valid="ignore"
    )
    found: dict[str, dict[str, Interval]] = {"": {}}
    values = _named(fit, theta, sizes, start, sense)
    drawn = [_named(fit, draw, sizes, start, sense) for draw in draws]
    moved = values if moved is None else moved
    for name, parameters in values.items():
        found[name] = {
            key: _interval(
                value,
                np.array([d[name][key] for d in drawn]),
                moved[name][key] - value,
                least=0.0 if name and key in _POSITIVE else -np.inf,
            )
            for key, value in parameters.items()
        }
    return found


def _interval(value: float, drawn: Floats, moved: float, least: float) -> Interval:
    drawn = drawn[np.isfinite(drawn)]
    low, high = np.quantile(drawn, (0.025, 0.975)) if len(drawn) else (value, value)
    doubt = abs(moved) if np.isfinite(moved) else 0.0
    below = _WIDER * float(np.hypot(max(value - low, 0.0), doubt))
    above = _WIDER * float(np.hypot(max(high - value, 0.0), doubt))
    return Interval(float(value), float(max(value - below, min(least, value))), float(value + above))


def _named_by(regression: RecordingRegression, fit: ModelFit) -> dict[str, Values]:
    theta, sizes = _point(fit)
    return _named(fit, theta, sizes, regression.signals.origin_s, regression.sense)


def _point(fit: ModelFit) -> tuple[Floats, list[tuple[str, int]]]:
    shapes = [(name, len(shape)) for name, shape in fit.model.items()]
    flat = [value for shape in fit.model.values() for value in shape]
    return np.concatenate([fit.coefficients, flat]), shapes


def _named(
    fit: ModelFit, theta: Floats, sizes: list[tuple[str, int]], start: float, sense: float
) -> dict[str, Values]:
    count = len(fit.owners)
    linear, at = theta[:count] * sense, count
    base = linear[:3]
    named: dict[str, Values] = {"": dict(zip(BASE, base, strict=True))}
    for name, size in sizes:
        shape = tuple(theta[at : at + size])
        at += size
        own = linear[[i for i, owner in enumerate(fit.owners) if owner == name]]
        named[base_name(name)] = NAMINGS[name](own, shape, base, start)
    return named


def _covariance(regression: RecordingRegression, fit: ModelFit) -> Floats:
    jacobian = jacobian_of(regression, fit)
    design = jacobian[:, : len(fit.coefficients)]
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    scale[scale == 0.0] = 1.0
    gram = (jacobian / scale).T @ (jacobian / scale)
    gram[np.diag_indices_from(gram)] += 1e-10
    variance = fit.rss / max(1, fit.n - len(scale))
    inverse = np.linalg.inv(gram)
    residual = regression.target - design @ fit.coefficients
    wider = np.sqrt(
        np.maximum(1.0, _robust(jacobian / scale, residual, inverse) / (variance * np.diag(inverse)))
    )
    return np.asarray(inverse * variance * np.outer(wider, wider) / np.outer(scale, scale))


def _robust(jacobian: Floats, residual: Floats, inverse: Floats) -> Floats:
    """Variances that hold for residuals of any memory shorter than a block (Liang and Zeger, 1986)."""
    scores = [
        block.T @ r
        for block, r in zip(np.array_split(jacobian, _BLOCKS), np.array_split(residual, _BLOCKS), strict=True)
    ]
    moved = np.array(scores) @ inverse
    return np.asarray(np.sum(moved**2, axis=0) * _BLOCKS / (_BLOCKS - 1))


def jacobian_of(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Derivatives of the whitened prediction by coefficients and shapes, at the rows that count."""
    design, _ = regression.design(fit.model)
    slopes = [
        _slope(regression, fit, name, i) for name, shape in fit.model.items() for i in range(len(shape))
    ]
    return np.column_stack([design, *slopes])


def _slope(regression: RecordingRegression, fit: ModelFit, name: str, index: int) -> Floats:
    """Derivative of the whitened prediction by one shape parameter, by a central difference."""
    shape = fit.model[name]
    grid = [point[index] for point in CANDIDATES[name].grid(regression.extent)] if name != "pulsation" else []
    step = _STEP * (abs(shape[index]) if CANDIDATES[name].logarithmic else grid[-1] - grid[0])
    if name == "pulsation":
        step = 0.02 / regression.extent.duration_s
    sides = []
    for sign in (1.0, -1.0):
        moved = (*shape[:index], shape[index] + sign * step, *shape[index + 1 :])
        sides.append(regression.design({**fit.model, name: moved})[0] @ fit.coefficients)
    return np.asarray((sides[0] - sides[1]) / (2.0 * step))
