"""Held-out gain on the force as recorded, where the sensor has faults that the band does not show."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.blocks import RmsGain, gain_over, held_out_prediction, numbers_at
from forefeel.diagnosis.diagnose.faults import Cleaned
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression


class AsRecorded:
    """The raw force beside held-out predictions of it.

    Lines and rounding are predicted, a limit clips the prediction. A spike can not be predicted: where the
    model knows of spikes the sample is replaced by the median of its neighbours, elsewhere it is an error.
    """

    def __init__(self, regression: RecordingRegression, recording: Recording, cleaned: Cleaned) -> None:
        assert recording.force_n is not None
        self.regression, self.cleaned, self.raw_n = regression, cleaned, recording.force_n
        self.t = recording.time_s - regression.signals.origin_s
        own = regression.signals.t[regression.rows]

        inside = (self.t >= own[0]) & (self.t <= own[-1])
        self.rows: NDArray[np.int64] = np.flatnonzero(inside)

    def gain(self, before: ModelFit, after: ModelFit, known: Collection[str]) -> RmsGain:
        """From a fit and a perfect sensor to a fit and the sensor with its known faults."""
        numbers = numbers_at(self.regression, self.t[self.rows])
        errors = self.errors(before, ()), self.errors(after, known)
        return gain_over(numbers, *errors)

    def errors(self, fit: ModelFit, known: Collection[str]) -> Floats:
        """In N at the recorded stamps, from the first to the last that counts."""
        coarse = held_out_prediction(self.regression, fit)
        said = np.empty(len(self.t))
        signals = self.regression.signals
        for piece in signals.piecewise(fine=False):
            t = signals.t[piece]
            here = (self.t >= t[0]) & (self.t <= t[-1])
            said[here] = CubicSpline(t, coarse[piece])(self.t[here])
        measured = self.raw_n
        if "sensor_spikes" in known:
            measured = np.where(self.cleaned.spikes, self.cleaned.force_n + self.cleaned.lines_n, measured)
        return (measured - self._through(said, known))[self.rows]

    def _through(self, said: Floats, known: Collection[str]) -> Floats:
        """What a sensor with these faults shows of a force."""
        values = {fault.name: fault.parameters for fault in self.cleaned.faults if fault.name in known}
        if "mains_hum" in known:
            said = said + self.cleaned.lines_n
        if "sensor_saturation" in values:
            top, bottom = float(np.max(self.raw_n)), float(np.min(self.raw_n))
            said = np.clip(said, bottom, top)
        if "sensor_quantisation" in values:
            step = float(values["sensor_quantisation"]["step_n"][0])
            origin = float(self.raw_n[0])
            said = origin + step * np.round((said - origin) / step)
        return said
