"""A delay and a lag in the frequency domain: how late and how large the force is beside the model's."""

from dataclasses import replace

import numpy as np
from scipy.signal import csd, welch

from forefeel.common.error_size import Floats
from forefeel.diagnose.drawing import common_legend, drawn, finish
from forefeel.diagnosis.diagnose.candidates import CANDIDATES
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.diagnose.transfer import alignment
from forefeel.report.svg import BLUE, ORANGE, Drawing, new_figure

_COHERENT = 0.8
_STRETCHES = 8.0
_HIGHEST = 3.0
_CAPTIONS = {
    "time_delay": "A delay turns the phase evenly with the frequency and leaves the size as it is.",
    "unmodelled_resonance:fixture": "Below the mode the force is as modelled, above it turned and smaller.",
    "sensor_lag": "A lag turns the phase by 90 degrees at most and makes a fast force smaller.",
}


def phase(stem: str, regression: RecordingRegression, fit: ModelFit, name: str) -> Drawing:
    """Phase and ratio of the measured force to the model's without `name`, where both go together."""
    frequency, ratio = response(regression, fit, name)
    figure = new_figure(3.1, 6.2)
    left, right = figure.subplots(1, 2)
    hz = np.linspace(0.0, float(frequency.max(initial=1.0)), 400)
    law = alignment(2.0 * np.pi * hz, {name: fit.model[name]})
    assert law is not None
    angle = np.unwrap(np.angle(law))
    near = np.interp(frequency, hz, angle)  # of several turns the one beside the law
    measured = near + np.angle(ratio * np.exp(-1j * near))
    for axes, dots, line, label in (
        (left, np.degrees(measured), np.degrees(angle), "phase in degrees"),
        (right, np.abs(ratio), np.abs(law), "measured / modelled"),
    ):
        axes.plot(frequency, dots, ".", color=ORANGE, markersize=5, label="measured")
        axes.plot(hz, line, color=BLUE, linewidth=1.5, label="the cause")
        finish(axes, "frequency in Hz", label, legend=False)
    common_legend(figure, left)
    right.set_ylim(0.0, min(_HIGHEST, 1.2 * max(1.0, float(np.abs(law).max()), *np.abs(ratio).tolist())))
    return drawn(figure, stem, "Phase and size over the frequency", _CAPTIONS[name])


def response(regression: RecordingRegression, fit: ModelFit, name: str) -> tuple[Floats, Floats]:
    """(Hz, measured force over that of the model without `name`), where their coherence is high."""
    rest = {other: shape for other, shape in fit.model.items() if other != name}
    signals = regression.signals
    piece = max(signals.piecewise(fine=False), key=lambda p: p.stop - p.start)
    sensed = [other for other in rest if CANDIDATES[other].kind == "sensor"]
    added = sum((regression.block(rest, o, rest[o]) @ fit.of(o) for o in sensed), np.zeros(len(signals.t)))
    without = regression.predicted(replace(fit, model=rest)) - added
    model, force = without[piece], (signals.force - added)[piece]
    rate = signals.coarse_rate_hz
    count = max(32, int(len(model) / _STRETCHES))
    frequency, cross = csd(model, force, rate, nperseg=count)
    own, other = welch(model, rate, nperseg=count)[1], welch(force, rate, nperseg=count)[1]
    coherent = np.abs(cross) ** 2 / np.maximum(own * other, 1e-300)
    rows = (coherent > _COHERENT) & (frequency > 0.0) & (frequency < 0.7 * signals.cutoff_hz)
    return frequency[rows], (cross / np.maximum(own, 1e-300))[rows]
