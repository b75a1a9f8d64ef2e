"""Force that each rival of a diagnosis foretells along a motion that was not made yet."""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from forefeel.common.causes.candidate import base_name
from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import Diagnosed
from forefeel.diagnosis.expected_gain import parameter_errors
from forefeel.diagnosis.regression import ModelFit
from forefeel.diagnosis.signals import Signals
from forefeel.diagnosis.uncertainty import plain_jacobian

_MOST_RIVALS = 5
_INTERVAL = 0.025, 0.975


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Force in N of a model of `causes` (none: mass, damper, spring alone) at the times t in s of a motion;
    `low_n`, `high_n`: 95 % interval by the covariance of its parameters. All of shape (n,).
    """

    causes: tuple[str, ...]
    t: Floats
    force_n: Floats
    low_n: Floats
    high_n: Floats

    @property
    def most_n(self) -> float:
        """Largest size of the force."""
        return float(np.max(np.abs(self.force_n)))


class Rivals:
    """Models that a diagnosis leaves, with draws of the errors of their parameters: the simulation alone,
    what the search has fitted, each cause of the rival groups.
    """

    def __init__(self, diagnosed: Diagnosed) -> None:
        self._regression, rng = diagnosed.analysis.regression, np.random.default_rng(0)
        self._fits = _fits(diagnosed)
        self._errors = [parameter_errors(self._regression, fit, rng) for fit in self._fits.values()]

    def along(self, motion: Recording) -> list[Forecast]:
        """Forecast of each rival along a motion, positive where it resists; empty where the motion is too
        short for the diagnosis's band.
        """
        regression = self._regression
        signals = Signals.of_motion(motion.time_s, motion.position_m, regression.signals.cutoff_hz)
        if signals is None:
            return []
        made, rows, sense = [], signals.rows, regression.sense
        for (causes, fit), errors in zip(self._fits.items(), self._errors, strict=True):
            other = regression.like(signals, fit)
            force_n = sense * other.predicted(fit)[rows]
            off_n = np.quantile(sense * errors @ plain_jacobian(other, fit)[rows].T, _INTERVAL, axis=0)
            made.append(Forecast(causes, signals.t[rows], force_n, *(force_n + off_n)))
        return made


def _fits(diagnosed: Diagnosed) -> dict[tuple[str, ...], ModelFit]:
    """Fits of up to five rivals by the names of their causes: the simulation alone, what the search has
    fitted, and the simulation with one cause of the rival groups.
    """
    analysis, search = diagnosed.analysis, diagnosed.analysis.search
    searched = tuple(sorted(base_name(name) for name in analysis.fit.model if name != "bias"))
    base, fits = analysis.base, {(): analysis.base, searched: analysis.fit}
    for name in dict.fromkeys(chain.from_iterable(diagnosed.diagnosis.rivals)):
        forms = [form for form in search.names if base_name(form) == name and form not in base.model]
        fitted = [fit for form in forms if (fit := search.best_with(base, form)) is not None]
        if fitted and len(fits) < _MOST_RIVALS:
            fits.setdefault((name,), min(fitted, key=lambda fit: fit.score))
    return fits
