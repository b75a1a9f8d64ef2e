"""Curves of the figures of a diagnosis, in the band in which motion and force are compared."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import csd, welch

from forefeel.common.causes.candidate import Changing, ReadingColumns
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import Floats
from forefeel.diagnosis.analysis import Analysis
from forefeel.diagnosis.identifiability import turning_points
from forefeel.diagnosis.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.signals import Signals
from forefeel.report.drawing import AxisUnit, Range, limits

Rows = NDArray[np.intp]
Part = tuple[str, str, Floats]
"""Name, colour and values of a line; label, unit and values of an axis."""

LEFT, MODEL = "readback", "predicted"
"""Colours of the residual and of the force of a model."""
_TRIM = 0.002  # share of the highest and of the lowest values that may lie outside of a picture
_COHERENT = 0.8  # least coherence of a frequency at which phase and ratio are shown
_STRETCHES = 8.0  # of the recording, over which a spectrum is averaged


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Forces in N and motion in SI on the coarse grid, all of one shape; `rows` are the samples that count.

    `simulated` is the given model's force or that of the fitted mass, damper, spring and bias.
    """

    analysis: Analysis
    given: bool
    t: Floats
    x: Floats
    v: Floats
    force: Floats
    simulated: Floats
    extended: Floats

    @property
    def rows(self) -> Rows:
        return np.flatnonzero(self.analysis.regression.signals.rows)

    @property
    def extends(self) -> bool:
        """True where the extended model is another than the simulation."""
        return self.given or self.analysis.fit.model != self.analysis.base.model

    @property
    def gap_s(self) -> float:
        """A longer pause interrupts a line."""
        return max(0.1, 3.0 / self.analysis.regression.signals.coarse_rate_hz)

    @property
    def before(self) -> Floats:
        return self.force - self.simulated

    @property
    def after(self) -> Floats:
        return self.force - self.extended

    @property
    def left(self) -> list[Part]:
        """Residual in N of the simulation, and of the extended model where it is another."""
        parts = [("left by the simulation", LEFT, self.before)]
        return [*parts, ("left by the extended model", MODEL, self.after)] if self.extends else parts

    @classmethod
    def of(cls, analysis: Analysis, given: ContactModel | None) -> "Curves":
        """Makes the curves: motion, measured force, and the forces of simulation and extended model, on the
        coarse grid. `given`: the simulation; None: the fitted mass, damper, spring and bias.
        """
        regression = analysis.regression
        signals, motion = regression.signals, regression.motion({})
        x, v = (np.interp(signals.t, signals.fine_t, fine) for fine in (motion.x, motion.v))
        simulated = regression.predicted(analysis.base) if given is None else regression.force_of(given)
        extended = regression.predicted(analysis.fit)
        return cls(analysis, given is not None, signals.t, x, v, signals.force, simulated, extended)


def force_of_cause(regression: RecordingRegression, fit: ModelFit, name: str) -> Floats:
    """Force in N that a cause adds to the model's, other parameters as they are; on the coarse grid."""
    whole = regression.predicted(fit)
    if not isinstance(CANDIDATES[name], Changing):
        return np.asarray(whole - regression.predicted(fit, leave=name))
    rest = {other: shape for other, shape in fit.model.items() if other != name}
    return np.asarray(whole - regression.predicted(replace(fit, model=rest)))


def response(regression: RecordingRegression, fit: ModelFit, name: str) -> tuple[Floats, Floats]:
    """Frequencies in Hz, and at each the complex ratio of the measured force to that of the model without
    `name`; only where their coherence is above 0.8 and within the pass-band, on the longest piece without
    gaps. Causes in the readings are taken out of both.
    """
    rest = {other: shape for other, shape in fit.model.items() if other != name}
    signals = regression.signals
    piece = max(signals.piecewise(fine=False), key=lambda p: p.stop - p.start)
    sensed = [other for other in rest if isinstance(CANDIDATES[other], ReadingColumns)]
    added = sum((regression.block(rest, o, rest[o]) @ fit.of(o) for o in sensed), np.zeros(len(signals.t)))
    without = regression.predicted(replace(fit, model=rest)) - added
    model, force = without[piece], (signals.force - added)[piece]
    rate = signals.coarse_rate_hz
    count = max(32, int(len(model) / _STRETCHES))
    frequency, cross = csd(model, force, rate, nperseg=count)
    model_power, force_power = welch(model, rate, nperseg=count)[1], welch(force, rate, nperseg=count)[1]
    coherent = np.abs(cross) ** 2 / np.maximum(model_power * force_power, 1e-300)
    rows = (coherent > _COHERENT) & (frequency > 0.0) & (frequency < 0.7 * signals.cutoff_hz)
    return frequency[rows], (cross / np.maximum(model_power, 1e-300))[rows]


def since_reversal(curves: Curves, least_m: float | None = None) -> tuple[Floats, Floats]:
    """Direction (1, -1) and distance in m since the last reversal; a way back of up to `least_m` is no
    reversal, by default a fiftieth of the range.

    Both on the coarse grid; 0 before the first reversal of a stretch without gaps.
    """
    direction, since = np.zeros_like(curves.x), np.zeros_like(curves.x)
    least_m = 0.02 * float(np.ptp(curves.x)) if least_m is None else least_m
    for piece in curves.analysis.regression.signals.piecewise(fine=False):
        x = curves.x[piece]
        turns = turning_points(x.tolist(), least_m)
        for (start, way), (stop, _) in pairwise([*turns, (len(x), 0.0)]):
            direction[piece.start + start : piece.start + stop] = way
            since[piece.start + start : piece.start + stop] = np.abs(x[start:stop] - x[start])
    return direction, since


def density(signals: Signals, values: Floats, longest_s: float = 8.0) -> tuple[Floats, Floats]:
    """Frequencies in Hz and amplitude density in N/sqrt(Hz) of the longest stretch without gaps, within the
    pass-band. Samples that do not count are taken as 0; `longest_s`: of a segment that is averaged.
    """
    piece = max(signals.piecewise(fine=False), key=lambda p: p.stop - p.start)
    rate = signals.coarse_rate_hz
    used = np.where(signals.rows[piece], values[piece], 0.0)
    frequency, power = welch(used, rate, nperseg=min(len(used), int(longest_s * rate)))
    inside = (frequency > 0.0) & (frequency < 0.75 * signals.cutoff_hz)
    return frequency[inside], np.sqrt(power[inside])


def near(unit: AxisUnit, *values: Floats, zero: bool = True) -> Range | None:
    """Limits of y for the values in a unit, without extreme ones; None without values."""
    return limits(*(unit(column) for column in values), trim=_TRIM, zero=zero)
