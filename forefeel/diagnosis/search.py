"""Search of causes: forward, backward and exchange steps by penalised likelihood, shapes refined jointly."""

from collections.abc import Iterable

import numpy as np

from forefeel.common.causes.candidate import Model, Periodic, PositionWave, Shape, base_name
from forefeel.common.causes.catalogue import CANDIDATES, kin
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance
from forefeel.diagnosis.refine import Refiner
from forefeel.diagnosis.regression import ModelFit, RecordingRegression

ADD = 12.0
"""How much the penalised -2 log likelihood must fall for a change of the model."""

ASYMMETRIC = "coulomb_friction:asymmetric"
MOST_CAUSES = 6
MOST_EVALUATIONS = 15_000
"""Least squares after which the search takes no further step."""
_STARTS = 3
_ROUGH = 30
_NEAR, _NEARER = 0.3, 0.1
"""An exchange is refined when it is so near on the grid, and all shapes with it when the new one's alone are;
in what the cause explains.
"""
_SAME = 3.0
"""Scores of one and the same model that was refined on two ways."""
_CLEARLY = 0.01
"""Of the residual's power: less is within how columns are sampled and noise is coloured."""
_SUBHARMONIC = 15.0
"""How much better a weaker line or half of a frequency must be: both can hold the strongest as harmonic."""
_MORE_THAN_NOISE = 1.2  # times the rms of the noise, which is known to about that
_PRACTICAL = 1.1
"""By how much the residual's rms must fall with several causes at once: less is within what is left
unexplained."""


class Search(Refiner):
    """Searches models of one regression; fits are remembered.

    Args:
        regression: the recording.
        names: the candidates that may be used; by default all that are known now.
        noise_n: rms of the noise in the band; 0 where it is not known.
    """

    def __init__(
        self, regression: RecordingRegression, names: Iterable[str] | None = None, noise_n: float = 0.0
    ) -> None:
        super().__init__(regression)
        self.noise_n = noise_n
        self.names = [name for name in (CANDIDATES if names is None else names) if name in CANDIDATES]

    def run(self, start: Model, passed: dict[frozenset[str], float] | None = None) -> ModelFit:
        """Steps from `start` on to the model that no single step betters.

        `passed`: names and scores of the models that runs went on from, added to here; one that meets such a
        model ends there, for it would go the same way.
        """
        passed = {} if passed is None else passed
        best = self._sound(self.refined(self.fit(start)))
        for _ in range(3 * MOST_CAUSES):
            names = frozenset(best.model)
            if self.evaluations > MOST_EVALUATIONS or passed.get(names, np.inf) < best.score + _SAME:
                break
            passed[names] = best.score
            step = self._backward(best) or self._exchange(best) or self._forward(best)
            if step is None:
                break
            best = step
        return self._symmetric(best)

    def _sound(self, fit: ModelFit) -> ModelFit:
        """Drops causes, the least needed first, until none has to be something that it can not be."""
        while not fit.feasible and fit.model:
            fit = min(
                (self.without(fit, name) for name in fit.model), key=lambda t: (not t.feasible, t.score)
            )
        return fit

    def _symmetric(self, fit: ModelFit) -> ModelFit:
        """Replaces friction that differs by direction by friction and a bias, if that fits about as well."""
        others = base_name(ASYMMETRIC), "bias"
        if ASYMMETRIC not in fit.model or "bias" in fit.model or not set(others) <= set(self.names):
            return fit
        rest = {name: shape for name, shape in fit.model.items() if name != ASYMMETRIC}
        offset = self.fit({**rest, **dict.fromkeys(others, ())})
        if not offset.feasible or offset.score > fit.score + max(ADD, _CLEARLY * fit.n):
            return fit
        return self._backward(offset) or offset

    def run_from_several(self, enough_n: float | None) -> ModelFit:
        """Best of several runs: from nothing, and from other first causes with one more added; from three of
        these, or from one where less than `enough_n` in N is left.

        Steps one at a time can walk past a pair of causes whose mixture looks like a third.
        """
        passed: dict[frozenset[str], float] = {}
        best = self.run({}, passed)
        if not best.model:
            return best
        starts = 1 if enough_n is not None and self.plain_rms(best) < enough_n else _STARTS
        empty = self.fit({})
        scanned = [self._scan(empty, name) for name in self._worth_trying(best)]
        ranked = sorted((s for s in scanned if s is not None), key=lambda s: s.score)
        tried = {base_name(name) for name in best.model}
        alone = len(tried)
        for start in ranked:
            (name,) = start.model
            if base_name(name) in tried or len(tried) >= starts + alone:
                continue
            tried.add(base_name(name))
            # without one more cause the first exchange would end where the other began
            grown = self._forward(self.refined(start))
            other = best if grown is None else self.run(grown.model, passed)
            if other.score < best.score - ADD:
                best = other
        return best

    def best_with(self, fit: ModelFit, name: str, near: float = np.inf) -> ModelFit | None:
        """Fit with one more cause, refined; None when none is feasible or its grid score is above `near`."""
        coarse = self._scan(fit, name)
        best = None if coarse is None or coarse.score > near else self.refined(coarse, only=name)
        return None if best is None or not best.feasible else best

    def _scan(self, fit: ModelFit, name: str) -> ModelFit | None:
        """Best feasible fit with one more cause on its grid, no echo of the motion; None where none is."""
        best: ModelFit | None = None
        periodic = isinstance(CANDIDATES[name], Periodic)
        repeats = periodic or isinstance(CANDIDATES[name], PositionWave)
        for shape in self._shapes(fit, name):
            trial = self.fit({**fit.model, name: shape})
            margin = _SUBHARMONIC if best is not None and repeats else 0.0
            better = best is None or trial.score < best.score - margin
            if better and trial.feasible and not (periodic and self.periods.echo(trial)):
                best = trial
        return best

    def _shapes(self, fit: ModelFit, name: str) -> list[Shape]:
        """Shapes to try for a cause: by lines or waves of the residual, else of its grid."""
        if isinstance(CANDIDATES[name], Periodic):
            return self.periods.lines(fit)
        if isinstance(CANDIDATES[name], PositionWave):
            return self.periods.over_position(fit)
        if base_name(name) == UnmodelledResonance.name:
            return [
                s for s in CANDIDATES[name].grid(self.regression.extent) if self.periods.resolved(name, s)
            ]
        if fit.model.get(name):
            return [fit.model[name], *CANDIDATES[name].grid(self.regression.extent)]
        return CANDIDATES[name].grid(self.regression.extent)

    def _forward(self, fit: ModelFit) -> ModelFit | None:
        """The best model with one more cause, costly if more than noise is left; None if none is worth it."""
        if len(fit.model) >= MOST_CAUSES:
            return None
        best = self._best_of(fit, [name for name in self.names if not CANDIDATES[name].costly])
        if self._leaves_more_than_noise(best or fit):
            costly = self._best_of(fit, [name for name in self._worth_trying(fit) if CANDIDATES[name].costly])
            trials = (trial for trial in (best, costly) if trial)
            best = min(trials, key=lambda trial: trial.score, default=None)
        return best

    def _best_of(self, fit: ModelFit, names: Iterable[str]) -> ModelFit | None:
        """The best of the models with one of these causes more; None when it is not worth it."""
        scanned = [self._scan(fit, name) for name in names if self.open_to(fit, name)]
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

    def _worth_trying(self, fit: ModelFit, rest: ModelFit | None = None) -> list[str]:
        """Names to try; costly ones only if `fit` leaves more than noise, and as only cause beside `rest`."""
        alone = not set((rest or fit).model) - {"bias"}
        much = alone and self._leaves_more_than_noise(fit)
        return [name for name in self.names if much or not CANDIDATES[name].costly]

    def _leaves_more_than_noise(self, fit: ModelFit) -> bool:
        return self.plain_rms(fit) > _MORE_THAN_NOISE * self.noise_n

    def open_to(self, fit: ModelFit, name: str) -> bool:
        """True if neither a form of that name nor another description of the same contact is in the model."""
        return kin(name) not in map(kin, fit.model)

    def worth(self, more: ModelFit, less: ModelFit) -> bool:
        """True if the larger model is better by likelihood and in size."""
        names = set(more.model) - set(less.model)
        new = CANDIDATES[names.pop()] if len(names) == 1 else None
        if less.score - more.score < (ADD if new is None else new.least_score):
            return False
        ratio = _PRACTICAL if new is None else new.least_ratio
        return less.rss > more.rss * ratio**2 or self.plain_rms(less) > self.plain_rms(more) * ratio

    def plain_rms(self, fit: ModelFit) -> float:
        """rms of the residual in N, not whitened."""
        return float(np.sqrt(np.mean(self.regression.residual(fit)[self.regression.rows] ** 2)))

    def _backward(self, fit: ModelFit) -> ModelFit | None:
        """The model without its least useful cause, when that is not worth its place."""
        smaller = [self.without(fit, name) for name in fit.model]
        smaller = [trial for trial in smaller if trial.feasible and not self.worth(fit, trial)]
        return min(smaller, key=lambda trial: trial.score) if smaller else None

    def without(self, fit: ModelFit, name: str) -> ModelFit:
        rest = {n: shape for n, shape in fit.model.items() if n != name}
        return self.refined(self.fit(rest), sweeps=1)

    def _exchange(self, fit: ModelFit) -> ModelFit | None:
        """The best model in which one cause gave way to another."""
        if not fit.model:
            return None
        # while the noise is taken for white, which overstates it, the residual's power must fall by 1 %, too
        least = 2.0 if self.regression.coloured else max(2.0, _CLEARLY * fit.n)
        best: ModelFit | None = None
        for name in fit.model:
            rest = self.fit({n: shape for n, shape in fit.model.items() if n != name})
            scanned = [
                self._scan(rest, other)
                for other in self._worth_trying(fit, rest)
                if other not in fit.model and self.open_to(rest, other)
            ]
            ranked = sorted((s for s in scanned if s is not None), key=lambda s: s.score)[:2]
            reach = abs(rest.score - fit.score)
            for trial in ranked:
                if trial.score > fit.score + _NEAR * reach:
                    continue
                (new,) = set(trial.model) - set(rest.model)
                rough = self.refined(trial, only=new, most=_ROUGH)
                better = self.refined(rough) if rough.score < fit.score + _NEARER * reach else rough
                if better.feasible and better.score < (best or fit).score - least:
                    best = better
        return best
