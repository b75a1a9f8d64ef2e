"""From a recording to the model that explains it best: conditioning, search and noise in turn."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.recording.recording import Recording
from diagnosis.diagnose.band import cutoff_hz, speed_band_m_s
from diagnosis.diagnose.faults import Cleaned, clean
from diagnosis.diagnose.noise import autoregression
from diagnosis.diagnose.regression import Fit, Regression
from diagnosis.diagnose.search import Search
from diagnosis.diagnose.signals import Signals

_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """What was found before it is judged."""

    cleaned: Cleaned
    regression: Regression
    search: Search
    fit: Fit


def analyse(recording: Recording, progress: Callable[[str], None] = lambda stage: None) -> Analysis:
    """Faults, band, search; the noise is learned from what the last search left, and the search repeated."""
    progress("sensor")
    cleaned = clean(recording)
    cutoff = cutoff_hz(recording, cleaned.force_n)
    signals = Signals(recording, cleaned.force_n, cutoff, cleaned.clipped)
    regression = Regression(signals, speed_band_m_s(recording, cutoff))
    search = Search(regression)
    progress("search")
    fit = search.run({})
    for _ in range(_ROUNDS):
        names = set(fit.model)
        residual = regression.residual(fit)
        regression.whiten_by(autoregression(residual, signals.rows, signals.piecewise(fine=False)))
        fit = search.run(fit.model)
        if set(fit.model) == names:
            break
    return Analysis(cleaned, regression, search, fit)


def residual_rms_n(analysis: Analysis) -> float:
    """What the fit leaves, in N, in the band."""
    rows = analysis.regression.signals.rows
    return float(np.sqrt(np.mean(analysis.regression.residual(analysis.fit)[rows] ** 2)))
