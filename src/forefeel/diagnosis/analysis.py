"""From a recording to the model that explains it best: conditioning, search and noise in turn."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from forefeel.common.causes.candidate import Model, base_name, form_name
from forefeel.common.causes.catalogue import CANDIDATES, cause_class, no_rivals
from forefeel.common.causes.sensor import SensorQuantisation, SensorSpikes
from forefeel.common.error_size import Floats
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.identifiability import motion_kind
from forefeel.diagnosis.noise import LEAST_CORNER_HZ, Noise, NoiseFloor, autoregression, noise_floor
from forefeel.diagnosis.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.search import ADD, Search
from forefeel.diagnosis.sensor_faults import Cleaned, clean
from forefeel.diagnosis.signals import Signals, cutoff_hz, speed_band_m_s, without_dependent_columns
from forefeel.diagnosis.verdict import Cause

Progress = Callable[[str], None]
_ROUNDS = 3
_NARROWER = 0.7
_TRIALS = 40
_LEAST_ROWS = 50  # of the regression, several for each coefficient of the largest model
_STILL = 0.05  # of the stage's step: an instrument that moves apart from it by less is carried
_IMPACT_S = 0.06  # s around the end of a play, in which it rings
_MOST_SPIKES = 0.6  # of the spikes
_SLOW_CORNER_HZ = 0.3  # Hz, of noise that is coloured above the motion: slower is taken for structure


@dataclass(frozen=True, eq=False)
class Analysis:
    """Result of a search. `base`: fit of mass, damper, spring and the cell's zero; `fit`: with causes."""

    cleaned: Cleaned
    regression: RecordingRegression
    search: Search
    base: ModelFit
    fit: ModelFit
    recording: Recording
    floor: NoiseFloor | None

    @property
    def faults(self) -> tuple[Cause, ...]:
        """Faults of `cleaned` but for spikes that are impacts at the end of a play (`_are_impacts`) and a
        quantisation whose error is below 0.4 of the residual's rms.
        """
        retained = []
        for fault in self.cleaned.faults:
            if fault.name == SensorSpikes.name and _are_impacts(self):
                continue
            if fault.name == SensorQuantisation.name and fault.explained_n < 0.4 * self.residual_rms_n:
                continue
            retained.append(fault)
        return tuple(retained)

    @property
    def residual_rms_n(self) -> float:
        return float(np.sqrt(np.mean(self.regression.residual(self.fit)[self.regression.signals.rows] ** 2)))

    @cached_property
    def narrower(self) -> tuple[RecordingRegression, ModelFit] | None:
        """Regression and fit of the same model below 0.7 of the cutoff, shapes refined, whitened by its own
        noise; computed once. Shows how much rests on the cutoff. None for a model without causes, or where
        too few samples are left.
        """
        if not self.fit.model:
            return None
        cutoff = _NARROWER * self.regression.signals.cutoff_hz
        try:
            signals = Signals(self.recording, self.cleaned.force_n, cutoff, self.cleaned.clipped)
        except RecordingError:
            return None
        band, look = self.regression.extent.speed_band, self.regression.look
        other = RecordingRegression(signals, band, look_result=look)
        residual = other.residual(other.fit(self.fit.model))
        other.whiten_by(noise_of(residual, signals, self.floor))
        return other, Search(other).refined(other.fit(self.fit.model), most=_TRIALS)

    def without(self, name: str) -> "Analysis":
        """Searches on without cause `name`, in all its forms, and returns that analysis; this one stays. Of a
        form that has a plainer one only that form is barred, and the search begins with the plainer one.

        If the new fit has causes that the old one lacked and is worse by `ADD` or more, penalties aside,
        these are barred too and the search is repeated; a bias, and causes of the same part of the bench as
        `name` with fewer coefficients, never are.
        """
        rest: Model = {other: shape for other, shape in self.fit.model.items() if other != name}
        form = CANDIDATES[name].plainer
        refused, one = {base_name(name)}, None
        if form is not None:
            plainer = form_name(base_name(name), form)
            refused, one = {name}, self.search.best_with(self.search.fit(rest), plainer)
        rest = rest if one is None else one.model
        same, numbers = no_rivals(name), len(CANDIDATES[name].signs)
        simpler = (n for n, c in CANDIDATES.items() if base_name(n) in same and len(c.signs) < numbers)
        known = {base_name(other) for other in (*rest, *simpler, "bias")}
        while True:
            allowed = [other for other in self.search.names if not {other, base_name(other)} & refused]
            search = Search(self.regression, allowed, self.search.noise_n)
            fit = search.run(rest)
            new = {base_name(other) for other in fit.model} - known
            if not new or fit.score - fit.penalty < self.fit.score - self.fit.penalty + ADD:
                break
            refused |= new
        return replace(self, search=search, fit=fit)

    def baseline(self) -> "Analysis":
        """Copy with the simulation as the fit and without the sensor's faults."""
        return replace(self, fit=self.base, cleaned=replace(self.cleaned, faults=[]))

    def noise_floor_n(self) -> float | None:
        """rms of the noise in the band, at most the residual's; None where the recording does not show it."""
        if self.floor is None:
            return None
        return min(in_band_n(self.floor, self.regression.signals), self.residual_rms_n)

    def flags(self) -> tuple[str, ...]:
        """Names of what limits the trust in the result, empty without any: `non_uniform` (stamps), `gaps`,
        `clipped`, `short` (under 10 s), `force_is_the_reaction`.
        """
        recording, flags = self.recording, []
        period = np.diff(recording.time_s)
        if float(np.quantile(period, 0.95)) > 1.05 * float(np.median(period)):
            flags.append("non_uniform")
        if len(recording.segments()) > 1:
            flags.append("gaps")
        if self.cleaned.clipped.any():
            flags.append("clipped")
        if recording.duration_s < 10.0:
            flags.append("short")
        if self.regression.sense < 0.0:
            flags.append("force_is_the_reaction")
        return tuple(flags)


def analyse(
    recording: Recording,
    progress: Progress = lambda stage: None,
    names: Sequence[str] | None = None,
    parts_s: tuple[float, ...] = (),
) -> Analysis:
    """Cleans the force and searches its causes; up to three times learns the noise from the residual and
    searches on, until the causes stay the same. At constant speed no cause is searched, whatever `names`.

    Further columns that belong to the same axis are dropped, see `without_dependent_columns`.

    Args:
        recording: with force.
        progress: called with each stage before it starts.
        names: the causes that are searched; by default all. Those of an angle need a position that is one.
        parts_s: of several recordings joined to one, when each but the first begins, in s since the start.

    Raises:
        RecordingError: a force of which only glitches change, too few samples in a row, or fewer than 50
            that can be compared.
    """
    progress("sensor")
    recording = without_dependent_columns(recording)
    cleaned = changing_force(recording)
    regression = conditioned(recording, cleaned, parts_s)
    signals = regression.signals
    _require(regression, recording, _LEAST_ROWS)
    progress("search")
    floor = noise_floor(recording, cleaned.force_n, cleaned.clipped)
    every = CANDIDATES if names is None else names
    names = [name for name in every if recording.rotary or not cause_class(name).rotary]
    if motion_kind(signals) == "constant_speed":
        names = []  # a line in time, beside which nothing can be told
    search = Search(regression, names, 0.0 if floor is None else in_band_n(floor, signals))
    fit = search.run_from_several(None if floor is None else 1.5 * search.noise_n)
    for _ in range(_ROUNDS):
        known = set(fit.model)
        residual = regression.residual(fit)
        regression.whiten_by(noise_of(residual, signals, floor))
        search.evaluations = 0
        fit = search.run(fit.model)
        if set(fit.model) == known:
            break
    return Analysis(cleaned, regression, search, regression.fit({"bias": ()}), fit, recording, floor)


def changing_force(recording: Recording, known: Sequence[Cause] = ()) -> Cleaned:
    """Cleans the force, see `clean`. Raises RecordingError where no more than glitches was in it."""
    cleaned = clean(recording, known)
    if float(np.ptp(cleaned.force_n)) == 0.0:
        raise RecordingError(
            f"{recording.source}: the force never changes but for glitches, expected a measured force"
        )
    return cleaned


def fitted_elsewhere(
    recording: Recording, cleaned: Cleaned, sense: float, *models: tuple[Model, Sequence[float]]
) -> Analysis:
    """Makes an analysis, without a search, of two models fitted elsewhere: the simulation, then the extended
    one. Coefficients are replaced by the given ones; rss and score stay those of a fit here.

    Args:
        sense: of the force, +1 where a positive one resists, else -1.
        models: each with its coefficients: mass, damping, stiffness, and those of its causes in turn, as in
            `ModelFit`.

    Raises:
        RecordingError: too few samples in a row.
    """
    regression = conditioned(recording, cleaned)
    regression.sense = sense
    base, fit = (
        replace(regression.fit(model), coefficients=np.array(coefficients)) for model, coefficients in models
    )
    return Analysis(cleaned, regression, Search(regression, []), base, fit, recording, None)


def conditioned(
    recording: Recording, cleaned: Cleaned, parts_s: tuple[float, ...] = ()
) -> RecordingRegression:
    """Makes the regression of a recording's cleaned force, low-passed at the cutoff of `cutoff_hz`; its noise
    is taken for white. `parts_s`: as in `analyse`.

    Raises:
        RecordingError: too few samples in a row, or none that can be compared.
    """
    cutoff = cutoff_hz(recording, cleaned.force_n)
    signals = Signals(recording, cleaned.force_n, cutoff, cleaned.clipped)
    reach_hz = min(2.0 * cutoff, signals.motion_reach_hz)
    regression = RecordingRegression(
        signals, speed_band_m_s(signals.even_m, signals.even_hz, reach_hz), parts_s
    )
    _require(regression, recording, 1)
    return regression


def _require(regression: RecordingRegression, recording: Recording, least: int) -> None:
    if np.count_nonzero(regression.rows) < least:
        raise RecordingError(f"{recording.source}: fewer than {least} samples of the force can be compared")


def in_band_n(floor: NoiseFloor, signals: Signals) -> float:
    """rms in N of the noise floor between one period of the recording and the cutoff."""
    return floor.rms_n(1.0 / float(signals.t[-1] - signals.t[0]), signals.cutoff_hz)


def noise_of(residual: Floats, signals: Signals, floor: NoiseFloor | None) -> Noise:
    """Autoregressive noise of a residual, coarse grid; corner 3 Hz, or 0.3 Hz beside a coloured floor."""
    corner_hz = LEAST_CORNER_HZ if floor is None or floor.slope == 0.0 else _SLOW_CORNER_HZ
    pieces = signals.piecewise(fine=False)
    return autoregression(residual, signals.rows, pieces, signals.coarse_rate_hz, corner_hz)


def _are_impacts(analysis: Analysis) -> bool:
    """True if over 60 % of the spikes are within 60 ms of the end of a play, where the model's instrument
    begins to move with the stage again. False without spikes, or if no cause changes the motion.
    """
    regression, spiked = analysis.regression, analysis.cleaned.spikes
    moved, stage = regression.motion(analysis.fit.model), regression.motion({})
    if moved is stage or not spiked.any():
        return False
    away_m = np.abs(np.diff(moved.x - stage.x, prepend=moved.x[0] - stage.x[0]))
    crossing = away_m > _STILL * np.abs(np.diff(stage.x, prepend=stage.x[0])) + 1e-12
    landed_s = moved.t[np.flatnonzero(crossing[:-1] & ~crossing[1:]) + 1] + regression.signals.origin_s
    at_s = analysis.recording.time_s[spiked]
    near = [bool(np.any(np.abs(landed_s - spike_s) < _IMPACT_S)) for spike_s in at_s]
    return float(np.mean(near)) > _MOST_SPIKES
