"""Which causes: forward, backward and exchange steps over groups by penalised likelihood, shapes refined
jointly.
"""

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from scipy.fft import rfft, rfftfreq
from scipy.optimize import minimize, minimize_scalar

from common.error_size import Floats
from diagnosis.diagnose.candidates import CANDIDATES, DRY, Candidate, Model, Shape, base_name
from diagnosis.diagnose.regression import Fit, Regression

ADD = 12.0
"""How much the penalised -2 log likelihood must fall for one more cause."""

ADD_BIAS = 4.0

ASYMMETRIC = "coulomb_friction:asymmetric"
PRACTICAL_OF = {"bias": 1.0, "unmodelled_resonance": 1.25}
MOST_CAUSES = 6
MOST_EVALUATIONS = 15_000
"""Least squares after which the search takes no further step."""
_STARTS = 3
_ROUGH = 30
_ALIKE = 0.9
_MANY = 9.0  # periods until harmonics stand apart
_BEYOND = 1.2
_SUBHARMONIC = 15.0
"""How much better a weaker line or half of a frequency must be: both can hold the strongest as harmonic."""
_SEEN_FROM_BELOW = 2.5
PRACTICAL = 1.1
"""By how much the residual's rms must grow when a cause is taken out: less is within what is left
unexplained."""

PULSATION_HZ = 0.12, 4.0


class Search:
    """Searches models of one regression; fits are remembered.

    Args:
        regression: the recording.
        names: the candidates that may be used; by default all that are known now.
    """

    def __init__(self, regression: Regression, names: Iterable[str] | None = None) -> None:
        self.regression = regression
        self.names = [name for name in (CANDIDATES if names is None else names) if name in CANDIDATES]
        self.evaluations = 0

    def run(self, start: Model) -> Fit:
        """The model that no single step betters, from `start` on."""
        best = self._sound(self.refined(self.fit(start)))
        for _ in range(3 * MOST_CAUSES):
            if self.evaluations > MOST_EVALUATIONS:
                break
            step = self._backward(best) or self._exchange(best) or self._forward(best)
            if step is None:
                break
            best = step
        return self._symmetric(best)

    def _sound(self, fit: Fit) -> Fit:
        """Without causes that the data ask to be something that they can not be."""
        while not fit.feasible and fit.model:
            fit = min(
                (self.without(fit, name) for name in fit.model), key=lambda t: (not t.feasible, t.score)
            )
        return fit

    def _symmetric(self, fit: Fit) -> Fit:
        """Levels that differ by direction are an offset of the cell where the recording can not tell them
        apart.
        """
        if ASYMMETRIC not in fit.model or "bias" in fit.model:
            return fit
        rest = {name: shape for name, shape in fit.model.items() if name != ASYMMETRIC}
        offset = self.fit({**rest, "coulomb_friction": (), "bias": ()})
        if not offset.feasible or offset.score > fit.score + ADD:
            return fit
        return self._backward(offset) or offset

    def run_from_several(self, enough_n: float | None) -> Fit:
        """As `run` from nothing; again from the runner-up of the first step, with one more cause, and from
        others while more than `enough_n` is left.

        Steps one at a time can walk past a pair of causes whose mixture looks like a third.
        """
        best = self.run({})
        if not best.model:
            return best
        starts = 1 if enough_n is not None and self.plain_rms(best) < enough_n else _STARTS
        empty = self.fit({})
        scanned = [self._scan(empty, name) for name in self.names]
        ranked = sorted((s for s in scanned if s is not None), key=lambda s: s.score)
        tried = {base_name(name) for name in best.model}
        alone = len(tried)
        for start in ranked:
            (name,) = start.model
            if base_name(name) in tried or len(tried) >= starts + alone:
                continue
            tried.add(base_name(name))
            grown = self._forward(
                self.refined(start)
            )  # or the first exchange would end where the other began
            other = best if grown is None else self.run(grown.model)
            if other.score < best.score - ADD:
                best = other
        return best

    def fit(self, model: Model) -> Fit:
        """One least squares."""
        self.evaluations += 1
        return self.regression.fit(model)

    def refined(self, fit: Fit, only: str | None = None, sweeps: int = 2, most: int = 70) -> Fit:
        """Shapes by bounded scalar searches in turn, each between its neighbours on the grid; shapes of one
        cause jointly, in at most `most` trials.
        """
        names = [n for n, shape in fit.model.items() if shape and (only is None or n == only)]
        for sweep in range(sweeps if len(names) > 1 or any(len(fit.model[n]) > 1 for n in names) else 1):
            before = fit.score
            for name in names:
                fit = self._refine_one(fit, name, sweep == 0, most)
            if before - fit.score < 0.5:
                break
        return fit

    def best_with(self, fit: Fit, name: str) -> Fit | None:
        """The model with one more cause, its shape refined; None when no shape is feasible."""
        coarse = self._scan(fit, name)
        best = None if coarse is None else self.refined(coarse, only=name)
        return None if best is None or not best.feasible else best

    def _scan(self, fit: Fit, name: str) -> Fit | None:
        """The best shape on the grid."""
        found: Fit | None = None
        for shape in self._shapes(fit, name):
            trial = self._quick(fit, name, shape)
            margin = 0.0 if found is None or name != "pulsation" else _SUBHARMONIC
            better = found is None or trial.score < found.score - margin
            if better and trial.feasible and not (name == "pulsation" and self._echo(trial)):
                found = trial
        return found

    def _quick(self, fit: Fit, name: str, shape: Shape) -> Fit:
        return self.fit({**fit.model, name: shape})

    def _shapes(self, fit: Fit, name: str) -> list[Shape]:
        if name == "pulsation":
            return self.lines(fit)
        if base_name(name) == "unmodelled_resonance":
            return [s for s in CANDIDATES[name].grid(self.regression.extent) if self._resolved(name, s)]
        if fit.model.get(name):
            return [fit.model[name], *CANDIDATES[name].grid(self.regression.extent)]
        return CANDIDATES[name].grid(self.regression.extent)

    def lines(self, fit: Fit, count: int = 4) -> list[Shape]:
        """The strongest lines of the whitened residual where pulses can be, and their halves."""
        regression = self.regression
        design, _ = regression.design(fit.model)
        rate = regression.signals.coarse_rate_hz
        residual = np.zeros(len(regression.rows))
        residual[regression.rows] = regression.target - design @ fit.coefficients
        length = 4 * len(residual)
        power = np.abs(rfft(residual, length)) ** 2
        frequency = rfftfreq(length, 1.0 / rate)
        low = max(PULSATION_HZ[0], 3.0 / regression.extent.duration_s)
        inside = (frequency >= low) & (frequency <= PULSATION_HZ[1])
        peaks: list[Shape] = []
        power = np.where(inside, power, 0.0)
        for _ in range(count):
            top = int(np.argmax(power))
            if power[top] <= 0.0:
                break
            peaks.append((float(frequency[top]),))
            power[np.abs(frequency - frequency[top]) < 1.5 / regression.extent.duration_s] = 0.0
        return peaks + [(f / 2.0,) for (f,) in peaks if f / 2.0 >= low]

    def _resolved(self, name: str, shape: Shape) -> bool:
        """Whether the motion has frequencies within a mode's width; one that repeats has harmonics only."""
        if base_name(name) != "unmodelled_resonance":
            return True
        period_s = self._motion_period_s
        reach_hz = self.regression.signals.motion_reach_hz
        if shape[0] > (0.9 if name.endswith(":free") else _SEEN_FROM_BELOW) * reach_hz:
            return False
        return period_s is None or 2.0 * shape[0] * shape[1] * period_s > 1.0

    @cached_property
    def _recorded_position(self) -> tuple[Floats, float]:
        """Of the longest piece without padding, less its mean, and its rate."""
        signals = self.regression.signals
        piece = max(signals.piecewise(), key=lambda p: p.stop - p.start)
        x = signals.fine_x[piece][signals.recorded[piece]]
        rate = 1.0 / float(signals.fine_t[piece][1] - signals.fine_t[piece][0])
        return x - np.mean(x), rate

    @cached_property
    def _motion_period_s(self) -> float | None:
        """With which the motion repeats; None when it does not."""
        x, rate = self._recorded_position
        power = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
        likeness = np.fft.irfft(power)[: len(x) // 2] / (1.0 - np.arange(len(x) // 2) / len(x))
        falling = np.flatnonzero(likeness < 0.5 * likeness[0])
        if not len(falling):
            return None
        again = falling[0] + np.flatnonzero(likeness[falling[0] :] > _ALIKE * likeness[0])
        if not len(again):
            return None
        first = likeness[again[0] : again[0] + max(2, int(again[0]) // 4)]  # the whole of the first peak
        return float(again[0] + int(np.argmax(first))) / rate

    def _echo(self, fit: Fit) -> bool:
        """Whether most of the pulses' power is at harmonics of a motion that repeats."""
        period_s, (frequency_hz,) = self._motion_period_s, fit.model["pulsation"]
        if period_s is None or self.regression.extent.duration_s < _MANY * period_s:
            return False
        sines = fit.of("pulsation").reshape(2, -1)
        power = np.sum(sines**2, axis=0)
        cycles = frequency_hz * np.arange(1, len(power) + 1) * period_s
        near = np.abs(cycles - np.round(cycles)) < 1.5 * period_s / self.regression.extent.duration_s
        return bool(power[near].sum() > 0.5 * power.sum())

    def _refine_one(self, fit: Fit, name: str, wide: bool, most: int) -> Fit:
        if len(fit.model[name]) > 1:
            return self._refine_jointly(fit, name, most)
        return self._refine_axis(fit, name, 0, wide)

    def _refine_jointly(self, fit: Fit, name: str, most: int) -> Fit:
        """Shapes of one cause that trade against each other: a simplex on their logarithms."""
        best = lowest = fit
        grid = np.log(np.array(CANDIDATES[name].grid(self.regression.extent)))
        low, high = grid.min(axis=0) - _BEYOND, grid.max(axis=0) + _BEYOND

        def cost(z: Floats) -> float:
            nonlocal best, lowest
            shape = tuple(float(value) for value in np.exp(z))
            if (z < low).any() or (z > high).any() or not self._resolved(name, shape):
                return fit.score + 1e3
            trial = self.fit({**fit.model, name: shape})
            if trial.score < best.score and trial.feasible:
                best = trial
            if trial.score < lowest.score and (trial.feasible or self.regression.no_peak(trial.model)):
                lowest = trial
            return trial.score + (0.0 if trial.feasible or self.regression.no_peak(trial.model) else 1e3)

        minimize(
            cost,
            np.log(fit.model[name]),
            method="Nelder-Mead",
            options={"maxfev": most, "xatol": 1e-3, "fatol": 0.1},
        )
        return best if best.score < lowest.score + 1.0 else lowest

    def _refine_axis(self, fit: Fit, name: str, index: int, wide: bool) -> Fit:
        candidate, shape = CANDIDATES[name], fit.model[name]
        low, high, logarithmic = self._bracket(candidate, shape, index, wide)
        best = fit

        def cost(z: float) -> float:
            nonlocal best
            value = float(np.exp(z)) if logarithmic else float(z)
            trial = self.fit({**fit.model, name: (*shape[:index], value, *shape[index + 1 :])})
            if trial.feasible and trial.score < best.score:
                best = trial
            return trial.score

        minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"maxiter": 12, "xatol": 1e-3 * (high - low)}
        )
        return best

    def _bracket(
        self, candidate: Candidate, shape: Shape, index: int, wide: bool
    ) -> tuple[float, float, bool]:
        value = shape[index]
        if candidate.name == "pulsation":
            reach = (0.6 if wide else 0.1) / self.regression.extent.duration_s
            return value - min(reach, 0.3 * value), value + reach, False
        grid = sorted({point[index] for point in candidate.grid(self.regression.extent)})
        if candidate.logarithmic:
            ratio = float(np.log(grid[-1] / grid[0])) / (len(grid) - 1) * (1.0 if wide else 0.15)
            low, high = float(np.log(grid[0])), float(np.log(grid[-1])) + 0.2
            at = min(max(float(np.log(value)), low), high)
            return max(at - ratio, low - 0.2), min(at + ratio, high), True
        step = (grid[-1] - grid[0]) / (len(grid) - 1) * (1.0 if wide else 0.15)
        at = min(max(value, grid[0]), grid[-1])
        return max(at - step, grid[0]), min(at + step, grid[-1]), False

    def _forward(self, fit: Fit) -> Fit | None:
        """The best of all models with one more cause, when it is worth it."""
        if len(fit.model) >= MOST_CAUSES:
            return None
        scanned = [self._scan(fit, name) for name in self.names if self._open(fit, name)]
        ranked = sorted((s for s in scanned if s is not None), key=lambda s: s.score)[:4]
        refined = [
            self.refined(trial, only=next(iter(set(trial.model) - set(fit.model))), most=_ROUGH)
            for trial in ranked
        ]
        refined = [trial for trial in refined if trial.feasible]
        if not refined:
            return None
        best = self.refined(min(refined, key=lambda trial: trial.score))
        return best if best.feasible and self.worth(best, fit) else None

    def _open(self, fit: Fit, name: str) -> bool:
        """Whether neither a form of that name nor another description of the same contact is in the model
        yet.
        """
        taken = {base_name(other) for other in fit.model}
        return base_name(name) not in taken and not (base_name(name) in DRY and taken & DRY)

    def worth(self, more: Fit, less: Fit) -> bool:
        """Whether the larger model is better by likelihood and in size."""
        names = {base_name(name) for name in set(more.model) - set(less.model)}
        # every load cell has a bias: it is named when it is there, however small beside the rest
        if less.score - more.score < (ADD_BIAS if names == {"bias"} else ADD):
            return False
        ratio = PRACTICAL_OF.get(next(iter(names)) if len(names) == 1 else "", PRACTICAL)
        return less.rss > more.rss * ratio**2 or self.plain_rms(less) > self.plain_rms(more) * ratio

    def plain_rms(self, fit: Fit) -> float:
        """Of the residual in N, not whitened."""
        return float(np.sqrt(np.mean(self.regression.residual(fit)[self.regression.rows] ** 2)))

    def _backward(self, fit: Fit) -> Fit | None:
        """The model without its least useful cause, when that is not worth its place."""
        smaller = [self.without(fit, name) for name in fit.model]
        smaller = [trial for trial in smaller if trial.feasible and not self.worth(fit, trial)]
        return min(smaller, key=lambda trial: trial.score) if smaller else None

    def without(self, fit: Fit, name: str) -> Fit:
        """The rest refitted."""
        rest = {n: shape for n, shape in fit.model.items() if n != name}
        return self.refined(self.fit(rest), sweeps=1)

    def _exchange(self, fit: Fit) -> Fit | None:
        """The best model in which one cause gave way to another."""
        if not fit.model:
            return None
        best: Fit | None = None
        for name in fit.model:
            rest = self.fit({n: shape for n, shape in fit.model.items() if n != name})
            scanned = [
                self._scan(rest, other)
                for other in self.names
                if other not in fit.model and self._open(rest, other)
            ]
            ranked = sorted((s for s in scanned if s is not None), key=lambda s: s.score)[:2]
            for trial in ranked:
                if trial.score < fit.score + 0.3 * abs(rest.score - fit.score):
                    better = self.refined(trial)
                    if better.feasible and better.score < (best or fit).score - 2.0:
                        best = better
        return best
