"""Pictures of the sensor's faults, on the force as recorded."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.signal import welch

from forefeel.common.error_size import Floats
from forefeel.diagnose.drawing import Axis, drawn, finish, logarithmic
from forefeel.diagnose.pictures import HEIGHT_IN, WIDTH_IN
from forefeel.diagnosis.diagnose.analysis import Analysis
from forefeel.diagnosis.diagnose.faults import Fault
from forefeel.report.svg import BLUE, GREY, ORANGE, VERMILION, Drawing, new_figure, plot, styled

_LEVELS = 8
_AROUND_HZ = 20.0


def sensor_picture(stem: str, analysis: Analysis, fault: Fault) -> Drawing | None:
    """Of a fault; None where no picture suits it."""
    draw = _PICTURES.get(fault.name)
    if draw is None:
        return None
    with styled():
        return draw(f"{stem} {fault.name}", analysis, fault)


def _raw(analysis: Analysis) -> Floats:
    force_n = analysis.recording.force_n
    assert force_n is not None
    return force_n


def _levels(stem: str, analysis: Analysis, fault: Fault) -> Drawing:
    force_n, step = _raw(analysis), fault.parameters["step_n"][0]
    middle = step * round(float(np.median(force_n)) / step)
    edges = middle + step * np.arange(-_LEVELS - 0.5, _LEVELS + 0.5 + 1e-9, 0.125)
    caption = f"Levels {1e3 * step:.4g} mN apart, and nothing between them."
    return _histogram(stem, force_n, edges, [], "Histogram of the readings", caption)


def _ends(stem: str, analysis: Analysis, fault: Fault) -> Drawing:
    force_n, limit = _raw(analysis), fault.parameters["limit_n"][0]
    margin = 0.03 * float(np.ptp(force_n))
    edges = np.linspace(float(force_n.min()) - margin, float(force_n.max()) + margin, 121)
    span = 2e-3 * float(np.ptp(force_n))
    lines = [end for end in (limit, -limit) if force_n.min() - span <= end <= force_n.max() + span]
    caption = "Readings pile up where the range ends (line)."
    return _histogram(stem, force_n, edges, lines, "Histogram of the readings", caption)


def _histogram(
    stem: str, force_n: Floats, edges: Floats, lines: list[float], title: str, caption: str
) -> Drawing:
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    inside = force_n[(force_n >= edges[0]) & (force_n <= edges[-1])]
    force = Axis("force", "N", inside)
    axes.hist(force(inside), force(edges).tolist(), color=ORANGE)
    for line in lines:
        axes.axvline(float(force(line)), color=VERMILION, linewidth=1.4)
    finish(axes, force.label, "readings", legend=False)
    return drawn(figure, stem, title, caption)


def _spikes(stem: str, analysis: Analysis, fault: Fault) -> Drawing:
    t = analysis.recording.time_s - analysis.recording.time_s[0]
    raw, cleaned = _raw(analysis), analysis.cleaned.force_n
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    force = Axis("force", "N", raw)
    axes.set_ylim(*(float(force(end)) for end in (raw.min(), raw.max())))
    plot(axes, t, force(raw), ORANGE, "as recorded")
    plot(axes, t, force(cleaned), BLUE, "without the outliers")
    finish(axes, "time in s", force.label)
    return drawn(figure, stem, "Over time", "Single readings far off their neighbours.")


def _line(stem: str, analysis: Analysis, fault: Fault) -> Drawing:
    frequency_hz, rate = fault.parameters["frequency_hz"][0], analysis.recording.rate_hz
    figure = new_figure(HEIGHT_IN, WIDTH_IN)
    axes = figure.subplots()
    for force_n, colour, name in (
        (_raw(analysis), ORANGE, "as recorded"),
        (analysis.cleaned.force_n, BLUE, "without the line"),
    ):
        piece = max(analysis.recording.segments(), key=lambda s: s.stop - s.start)
        frequency, power = welch(force_n[piece], rate, nperseg=min(len(force_n[piece]), int(8.0 * rate)))
        near = np.abs(frequency - frequency_hz) < _AROUND_HZ
        axes.semilogy(frequency[near], np.sqrt(power[near]), color=colour, label=name)
    axes.axvline(frequency_hz, color=GREY, linewidth=1.0, zorder=0)
    logarithmic(axes, x=False)
    finish(axes, "frequency in Hz", "force in N/√Hz")
    return drawn(figure, stem, "Spectrum of the readings", f"A narrow line at {frequency_hz:.2f} Hz.")


_PICTURES: Mapping[str, Callable[[str, Analysis, Fault], Drawing]] = {
    "sensor_quantisation": _levels,
    "sensor_saturation": _ends,
    "sensor_spikes": _spikes,
    "mains_hum": _line,
}
