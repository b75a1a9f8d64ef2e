"""From a recording to the model that explains it best: conditioning, search and noise in turn."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.band import cutoff_hz, speed_band_m_s
from forefeel.diagnosis.diagnose.faults import Cleaned, Fault, clean
from forefeel.diagnosis.diagnose.noise import Noise, autoregression
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.diagnose.search import Search
from forefeel.diagnosis.diagnose.signals import Signals
from forefeel.diagnosis.diagnose.structure import noise_cap_n

_ROUNDS = 3
_NARROWER = 0.7
_TRIALS = 40


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """What was found before it is judged."""

    cleaned: Cleaned
    regression: RecordingRegression
    search: Search
    fit: ModelFit
    recording: Recording
    narrower: tuple[RecordingRegression, ModelFit] | None

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Of the sensor, but for glitches that a play makes at reversals and steps that are finer than the
        noise.
        """
        kept = []
        for fault in self.cleaned.faults:
            if fault.name == "sensor_spikes" and "backlash" in self.fit.model and _few(fault, self):
                continue
            if fault.name == "sensor_quantisation" and fault.rms_n < 0.4 * residual_rms_n(self):
                continue
            kept.append(fault)
        return tuple(kept)

    def noise_floor_n(self) -> float:
        """rms in the band of the noise: not more than is left."""
        return residual_rms_n(self)

    def flags(self) -> tuple[str, ...]:
        """What limits the trust, as words with underscores."""
        recording, found = self.recording, []
        period = np.diff(recording.time_s)
        if float(np.quantile(period, 0.95)) > 1.05 * float(np.median(period)):
            found.append("non_uniform")
        if len(recording.segments()) > 1:
            found.append("gaps")
        if self.cleaned.clipped.any():
            found.append("clipped")
        if recording.duration_s < 10.0:
            found.append("short")
        if self.regression.sense < 0.0:
            found.append("force_is_the_reaction")
        return tuple(found)


def analyse(recording: Recording, progress: Callable[[str], None] = lambda stage: None) -> Analysis:
    """Faults, band, search; the noise is learned from what the last search left, and the search repeated."""
    progress("sensor")
    cleaned = clean(recording)
    cutoff = cutoff_hz(recording, cleaned.force_n)
    signals = Signals(recording, cleaned.force_n, cutoff, cleaned.clipped)
    reach_hz = min(2.0 * cutoff, signals.motion_reach_hz)
    regression = RecordingRegression(signals, speed_band_m_s(signals.even_m, signals.even_hz, reach_hz))
    search = Search(regression)
    progress("search")
    cap = noise_cap_n(recording, cleaned.force_n)
    fit = search.run_from_several(None if cap is None else 1.5 * cap)
    for _ in range(_ROUNDS):
        names = set(fit.model)
        residual = regression.residual(fit)
        regression.whiten_by(noise_of(residual, signals))
        search.evaluations = 0
        fit = search.run(fit.model)
        if set(fit.model) == names:
            break
    narrower = _in_narrower_band(recording, cleaned, regression, fit) if fit.model else None
    return Analysis(cleaned, regression, search, fit, recording, narrower)


def _in_narrower_band(
    recording: Recording, cleaned: Cleaned, regression: RecordingRegression, fit: ModelFit
) -> tuple[RecordingRegression, ModelFit] | None:
    """The same model fitted below a lower cutoff: how much of the answer rests on the choice of the band."""
    cutoff = _NARROWER * regression.signals.cutoff_hz
    try:
        signals = Signals(recording, cleaned.force_n, cutoff, cleaned.clipped)
    except ValueError:
        return None
    other = RecordingRegression(signals, regression.extent.speed_band)
    residual = other.residual(other.fit(fit.model))
    other.whiten_by(noise_of(residual, signals))
    return other, Search(other).refined(other.fit(fit.model), most=_TRIALS)


def noise_of(residual: Floats, signals: Signals) -> Noise:
    """The colour of a residual on the coarse grid."""
    return autoregression(residual, signals.rows, signals.piecewise(fine=False), signals.coarse_rate_hz)


def residual_rms_n(analysis: Analysis) -> float:
    """What the fit leaves, in N, in the band."""
    rows = analysis.regression.signals.rows
    return float(np.sqrt(np.mean(analysis.regression.residual(analysis.fit)[rows] ** 2)))


def _few(fault: Fault, analysis: Analysis) -> bool:
    return fault.parameters["rate_hz"][0] < 0.4 and fault.parameters["amplitude_n"][0] < 0.5 * float(
        np.std(analysis.cleaned.force_n)
    )
