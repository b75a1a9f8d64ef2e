"""Shape parameters of a model, refined: bounded scalar searches, and simplexes where several trade."""

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from forefeel.common.causes.candidate import Candidate, Model, Periodic, PositionWave
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.error_size import Floats
from forefeel.diagnosis.periods import LEAST_WAVES, Periods
from forefeel.diagnosis.regression import ModelFit, RecordingRegression

_BEYOND = 1.2  # of the logarithm of a shape: how far beyond its grid it is searched
_BEYOND_LINEAR = 0.15  # of the grid's range: the same where the scale is linear


class Refiner:
    """Fits models to one regression and refines their shapes; `evaluations` counts the least squares."""

    def __init__(self, regression: RecordingRegression) -> None:
        self.regression, self.periods = regression, Periods(regression)
        self.evaluations = 0

    def fit(self, model: Model) -> ModelFit:
        self.evaluations += 1
        return self.regression.fit(model)

    def refined(self, fit: ModelFit, only: str | None = None, sweeps: int = 2, most: int = 70) -> ModelFit:
        """Refines shapes by bounded scalar searches in turn, each between its neighbours on the grid; shapes
        of one cause jointly, in at most `most` trials.
        """
        names = [n for n, shape in fit.model.items() if shape and (only is None or n == only)]
        for sweep in range(sweeps if len(names) > 1 or any(len(fit.model[n]) > 1 for n in names) else 1):
            before = fit.score
            for name in names:
                if len(fit.model[name]) > 1:
                    fit = self._refine_jointly(fit, name, most)
                else:
                    fit = self._refine_alone(fit, name, sweep == 0)
            if before - fit.score < 0.5:
                break
        return fit

    def _refine_jointly(self, fit: ModelFit, name: str, most: int) -> ModelFit:
        """Refines shapes of one cause that trade against each other by a simplex, on their logarithms where
        the candidate says so; else in their ranges on the grid.
        """
        best = lowest = fit
        logarithmic = CANDIDATES[name].logarithmic
        grid = np.array(CANDIDATES[name].grid(self.regression.extent))
        zero, scale = (np.zeros(1), np.ones(1)) if logarithmic else (grid.min(axis=0), np.ptp(grid, axis=0))
        grid = np.log(grid) if logarithmic else (grid - zero) / scale
        beyond = _BEYOND if logarithmic else _BEYOND_LINEAR
        low, high = grid.min(axis=0) - beyond, grid.max(axis=0) + beyond
        if not logarithmic:  # what is positive everywhere on the grid stays so
            low = np.where(zero > 0.0, np.maximum(low, -zero / scale), low)
        shape = np.array(fit.model[name])
        start = np.log(shape) if logarithmic else (shape - zero) / scale
        steps = [0.5 / max(1, len(np.unique(column)) - 1) for column in grid.T]

        def cost(z: Floats) -> float:
            """Score, worse where not allowed; remembers the best feasible and the lowest fit."""
            nonlocal best, lowest
            values = np.exp(z) if logarithmic else zero + scale * z
            shape = tuple(float(value) for value in values)
            if (z < low).any() or (z > high).any() or not self.periods.resolved(name, shape):
                return fit.score + 1e3
            trial = self.fit({**fit.model, name: shape})
            if trial.score < best.score and trial.feasible:
                best = trial
            if trial.score < lowest.score and (trial.feasible or self.regression.no_peak(trial.model)):
                lowest = trial
            return trial.score + (0.0 if trial.feasible or self.regression.no_peak(trial.model) else 1e3)

        minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={
                "maxfev": most,
                "xatol": 1e-3,
                "fatol": 0.1,
                "initial_simplex": None if logarithmic else np.vstack([start, start + np.diag(steps)]),
            },
        )
        return best if best.score < lowest.score + 1.0 else lowest

    def _refine_alone(self, fit: ModelFit, name: str, wide: bool) -> ModelFit:
        """Refines the one shape of a cause by a bounded search; the best feasible fit, or the one given."""
        low, high, logarithmic = self._bracket(CANDIDATES[name], fit.model[name][0], wide)
        best = fit

        def cost(z: float) -> float:
            """Score; remembers the best feasible fit."""
            nonlocal best
            value = float(np.exp(z)) if logarithmic else float(z)
            trial = self.fit({**fit.model, name: (value,)})
            if trial.feasible and trial.score < best.score:
                best = trial
            return trial.score

        minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"maxiter": 12, "xatol": 1e-3 * (high - low)}
        )
        return best

    def _bracket(self, candidate: Candidate, value: float, wide: bool) -> tuple[float, float, bool]:
        """Lowest and highest value of a shape's search, and True if they are logarithms."""
        if isinstance(candidate, Periodic):
            reach = (0.6 if wide else 0.1) / self.regression.extent.duration_s
            return max(value - min(reach, 0.3 * value), self.periods.lowest_hz), value + reach, False
        if isinstance(candidate, PositionWave):
            reach = (0.5 if wide else 0.1) / self.regression.extent.range_m
            longest_m = self.regression.extent.range_m / LEAST_WAVES
            return 1.0 / (1.0 / value + reach), 1.0 / max(1.0 / value - reach, 1.0 / longest_m), False
        grid = sorted({point[0] for point in candidate.grid(self.regression.extent)})
        if candidate.logarithmic:
            ratio = float(np.log(grid[-1] / grid[0])) / (len(grid) - 1) * (1.0 if wide else 0.15)
            low, high = float(np.log(grid[0])), float(np.log(grid[-1])) + 0.2
            at = min(max(float(np.log(value)), low), high)
            return max(at - ratio, low - 0.2), min(at + ratio, high), True
        step = (grid[-1] - grid[0]) / (len(grid) - 1) * (1.0 if wide else 0.15)
        at = min(max(value, grid[0]), grid[-1])
        return max(at - step, grid[0]), min(at + step, grid[-1]), False
