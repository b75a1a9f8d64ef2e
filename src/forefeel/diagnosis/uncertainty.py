"""Uncertainty of a fit: errors in blocks that it was not fitted to, intervals of gains and of parameters.

Neighbouring errors are not independent; whole blocks are held out and drawn (Kuensch, Annals of Statistics
17, 1989).
"""

from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.candidate import Fitted, Periodic, Values, base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.causes.periodic import VARIES, Rhythm
from forefeel.common.error_size import Floats
from forefeel.diagnosis.regression import BASE, ModelFit, RecordingRegression
from forefeel.diagnosis.verdict import HeldOut, Interval

_MOST_BLOCKS = 16
_LEAST_S = 1.0
_BOOTSTRAP_DRAWS = 1000
_SEEN = 0.2


def block_numbers(regression: RecordingRegression) -> NDArray[np.int64]:
    """Block of each row that counts: its recording of several joined, else one of 4 to 16 equal ones."""
    t = regression.signals.t[regression.rows]
    if regression.parts_s:
        return np.asarray(np.searchsorted(regression.parts_s, t))
    count = int(np.clip(len(t) / regression.signals.coarse_rate_hz / _LEAST_S, 4, _MOST_BLOCKS))
    starts = np.linspace(0, len(t), count + 1).astype(np.int64)[1:-1]
    return np.asarray(np.searchsorted(t[starts], t, side="right"))


def held_out_errors(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Errors in N at the rows that count, each block predicted by coefficients fitted to all others; shapes
    stay, and coefficients that are 0 in the fit are 0 there, too.
    """
    white, plain = columns(regression, fit)
    acts = fit.coefficients != 0.0
    return held_out(regression, white[:, acts], plain[:, acts])


def columns(regression: RecordingRegression, fit: ModelFit) -> tuple[Floats, Floats]:
    """(whitened, plain) columns of a model at the rows that count."""
    return regression.design(fit.model), plain_columns(regression, fit)[regression.rows]


def plain_columns(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Columns of a model in N on the coarse grid, not whitened."""
    model = fit.model
    return np.hstack([regression.block(model, name, shape) for name, shape in [("", ()), *model.items()]])


def plain_jacobian(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Derivatives of the prediction by coefficients, then shapes, in N on the coarse grid, not whitened."""
    return np.hstack([plain_columns(regression, fit), slopes_of(regression, fit, white=False)])


def held_out(
    regression: RecordingRegression, white: Floats, plain: Floats, ridge: Floats | float = 1e-10
) -> Floats:
    """Errors in N at the rows that count, (rows,), each block predicted by coefficients fitted to all others.

    `white`, `plain`: any columns, (rows, n), whitened for the fit and as they are for the prediction.
    `ridge`: one, or one for each column scaled to an rms of 1. A column with over 80 % of its power in one
    block keeps its coefficient of all blocks there.
    """
    scale = np.sqrt(np.mean(white**2, axis=0))
    scale[scale == 0.0] = 1.0
    white = white / scale
    numbers = block_numbers(regression)
    gram, moment = white.T @ white, white.T @ regression.target
    full = np.linalg.solve(gram + np.diag(np.full(len(gram), 1.0) * ridge) * len(white), moment)
    thetas = np.tile(full, (int(numbers[-1]) + 1, 1))
    for number, theta in enumerate(thetas):
        rows = numbers == number
        part = white[rows]
        inner = gram - part.T @ part
        # what shows in this block only, such as a decay from the start, can not be learned elsewhere
        known = np.diag(inner) > _SEEN * np.diag(gram)
        inner[np.diag_indices_from(inner)] += ridge * len(white)
        right = moment - part.T @ regression.target[rows] - inner[:, ~known] @ full[~known]
        theta[known] = np.linalg.solve(inner[np.ix_(known, known)], right[known])
    force, theta = regression.signals.force[regression.rows], thetas / scale
    return np.asarray(force - np.einsum("ij,ij->i", plain, theta[numbers]))


def gain(regression: RecordingRegression, before: Floats, after: Floats) -> HeldOut:
    """Gain from one series of held-out errors to another, both at the rows that count."""
    return gain_over(block_numbers(regression), before, after)


def gain_over(numbers: NDArray[np.int64], before: Floats, after: Floats) -> HeldOut:
    """Gain, 1 - rms after / rms before, from one series of errors to another, with its 95 % interval by
    bootstrap over blocks; `numbers`: the block of each error.
    """
    sums = np.array([[np.sum(e[numbers == k] ** 2) for e in (before, after)] for k in np.unique(numbers)])
    rng = np.random.default_rng(0)
    drawn = sums[rng.integers(len(sums), size=(_BOOTSTRAP_DRAWS, len(sums)))].sum(axis=1)
    ratios = 1.0 - np.sqrt(drawn[:, 1] / np.maximum(drawn[:, 0], 1e-300))
    low, high = np.quantile(ratios, (0.025, 0.975))
    rms = [float(np.sqrt(np.mean(e**2))) for e in (before, after)]
    return HeldOut(rms[0], rms[1], 1.0 - rms[1] / max(rms[0], 1e-300), float(low), float(high))


_DRAWS = 2000
_STEP = 1e-3
_BLOCKS = 32
WIDER = 1.4
"""Calibrated: without it 88 % of the intervals hold the truth on recordings with a known one."""

_POSITIVE = frozenset({
    "stiffness_n_m", "second_stiffness_n_m", "time_constant_s", "second_time_constant_s", "width_m",
    "delay_s", "stribeck_velocity_m_s", "frequency_hz", "damping_ratio", "amplitude_n",
    "settling_s", "length_m", "release_s", "breakaway_m", "transition_speed_m_s", "wrap_rad", "wrap_rad_m",
})  # fmt: skip
"""What has no negative values in any cause: no interval reaches below zero."""


def intervals(
    regression: RecordingRegression,
    fit: ModelFit,
    elsewhere: tuple[RecordingRegression, ModelFit] | None = None,
) -> dict[str, dict[str, Interval]]:
    """95 % intervals of each cause's parameters, and of mass, damping, stiffness under "".

    Coefficients and shapes are drawn from the Gauss-Newton covariance `s^2 (J' J)^-1` on whitened data, J
    with the derivatives by the shapes; percentiles of the named parameters follow (propagation by draws). How
    far a value moves when the same model is fitted `elsewhere`, in another band, is added in square.
    """
    covariance = covariance_of(regression, fit)
    theta = _point(fit)
    rng = np.random.default_rng(0)
    size = np.sqrt(np.diag(covariance))  # sizes of one model differ by up to 1e30: what is left of a decay
    size[size == 0.0] = 1.0
    correlation = covariance / np.outer(size, size)
    draws = theta + size * rng.multivariate_normal(
        np.zeros(len(theta)), 0.5 * (correlation + correlation.T), _DRAWS, method="eigh", check_valid="ignore"
    )
    values = _named(regression, fit, theta)
    drawn = [_named(regression, fit, draw) for draw in draws]
    moved = values if elsewhere is None else _named(*elsewhere, _point(elsewhere[1]))
    return {
        name: {
            key: _interval(
                value,
                np.array([d[name][key] for d in drawn]),
                moved[name][key] - value,
                least=0.0 if name and key in _POSITIVE else -np.inf,
            )
            for key, value in parameters.items()
        }
        for name, parameters in values.items()
    }


def significant(parameters: dict[str, Interval]) -> dict[str, Interval]:
    """Parameters without those of a second element whose stiffness may be zero."""
    second = parameters.get("second_stiffness_n_m")
    if second is None or second.low > 0.0:
        return parameters
    return {key: value for key, value in parameters.items() if not key.startswith("second_")}


def _interval(value: float, drawn: Floats, moved: float, least: float) -> Interval:
    """Interval of 95 % of the draws about `value`; each side joined in square with how far the value `moved`,
    widened by 1.4, not below `least`. Draws that are not finite do not count.
    """
    drawn = drawn[np.isfinite(drawn)]
    low, high = np.quantile(drawn, (0.025, 0.975)) if len(drawn) else (value, value)
    doubt = abs(moved) if np.isfinite(moved) else 0.0
    below = WIDER * float(np.hypot(max(value - low, 0.0), doubt))
    above = WIDER * float(np.hypot(max(high - value, 0.0), doubt))
    return Interval(float(value), float(max(value - below, min(least, value))), float(value + above))


def _point(fit: ModelFit) -> Floats:
    """Coefficients, then shapes, in a row."""
    return np.concatenate([fit.coefficients, *map(np.asarray, fit.model.values())])


def _named(regression: RecordingRegression, fit: ModelFit, theta: Floats) -> dict[str, Values]:
    """Named parameters by cause, of mass, damper and spring under "", all for a force that resists; `theta`:
    coefficients, then shapes, as of `_point`, which may differ from the fit's own.
    """
    linear, shapes = theta[: len(fit.owners)] * regression.sense, iter(theta[len(fit.owners) :])
    base = linear[:3]
    named: dict[str, Values] = {"": dict(zip(BASE, base, strict=True))}
    for name, shape in fit.model.items():
        coefficients = linear[[i for i, owner in enumerate(fit.owners) if owner == name]]
        drawn = tuple(islice(shapes, len(shape)))
        fitted = Fitted(coefficients, drawn, base, regression.signals.origin_s)
        named[base_name(name)] = CANDIDATES[name].named(fitted)
    return named


def covariance_of(regression: RecordingRegression, fit: ModelFit) -> Floats:
    """Covariance of coefficients, then shapes; holds for residuals of any memory shorter than a block."""
    jacobian = np.column_stack([regression.design(fit.model), slopes_of(regression, fit)])
    design = jacobian[:, : len(fit.coefficients)]
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    scale[scale == 0.0] = 1.0
    gram = (jacobian / scale).T @ (jacobian / scale)
    gram[np.diag_indices_from(gram)] += 1e-10
    variance = fit.rss / max(1, fit.n - len(scale))
    known = np.zeros(len(fit.coefficients))
    for name, shape in fit.model.items():  # what no row shows of a course is as uncertain as rates are
        course = isinstance(CANDIDATES[name], Rhythm) and len(shape) > 1
        known = np.append(known, np.full(len(shape), (VARIES * np.mean(shape)) ** -2.0 if course else 0.0))
    gram[np.diag_indices_from(gram)] += variance * known / scale**2
    inverse = np.linalg.inv(gram)
    residual = regression.target - design @ fit.coefficients
    wider = np.sqrt(
        np.maximum(1.0, _robust(jacobian / scale, residual, inverse) / (variance * np.diag(inverse)))
    )
    return np.asarray(inverse * variance * np.outer(wider, wider) / np.outer(scale, scale))


def _robust(jacobian: Floats, residual: Floats, inverse: Floats) -> Floats:
    """Variances that hold for residuals of any memory shorter than a block (Liang and Zeger, 1986)."""
    blocks = zip(*(np.array_split(rows, _BLOCKS) for rows in (jacobian, residual)), strict=True)
    moved = np.array([block.T @ left for block, left in blocks]) @ inverse
    return np.asarray(np.sum(moved**2, axis=0) * _BLOCKS / (_BLOCKS - 1))


def slopes_of(regression: RecordingRegression, fit: ModelFit, white: bool = True) -> Floats:
    """Derivatives of the prediction by the shapes, a column for each: whitened, at the rows that count; or in
    N on the coarse grid.
    """
    pairs = [(name, i) for name, shape in fit.model.items() for i in range(len(shape))]
    slopes = [_slope(regression, fit, name, i, white) for name, i in pairs]
    count = len(regression.target) if white else len(regression.signals.t)
    return np.column_stack(slopes) if slopes else np.empty((count, 0))


def _slope(regression: RecordingRegression, fit: ModelFit, name: str, index: int, white: bool) -> Floats:
    """Derivative of the prediction by one shape parameter, by a central difference, coefficients kept:
    whitened at the rows that count if `white`, else in N on the coarse grid.
    """
    shape = fit.model[name]
    candidate = CANDIDATES[name]
    if isinstance(candidate, Periodic | Rhythm):
        step = 0.02 / regression.extent.duration_s
    elif candidate.logarithmic:
        step = _STEP * abs(shape[index])
    else:
        grid = [point[index] for point in candidate.grid(regression.extent)]
        step = _STEP * (grid[-1] - grid[0])
    sides = []
    for sign in (1.0, -1.0):
        moved = (*shape[:index], shape[index] + sign * step, *shape[index + 1 :])
        model = {**fit.model, name: moved}
        if white:
            sides.append(regression.design(model) @ fit.coefficients)
        else:
            sides.append(regression.predicted(replace(fit, model=model)))
    return np.asarray((sides[0] - sides[1]) / (2.0 * step))
