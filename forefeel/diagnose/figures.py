"""The figures of a diagnosis: what the simulation leaves, against all that could explain it, before and
after.
"""

import numpy as np
from matplotlib.axes import Axes
from scipy.signal import welch

from common.error_size import Floats
from diagnosis.diagnose.analysis import Analysis
from diagnosis.diagnose.flexible import since_reversal
from diagnosis.diagnose.regression import Fit
from forefeel.report.svg import BLACK, BLUE, ORANGE, Drawing, new_figure, plot, styled, to_svg

_POINTS = 700
_BINS = 24


def drawings(stem: str, analysis: Analysis) -> list[Drawing]:
    """Force over time, residual over time, over motion, its spectrum."""
    regression = analysis.regression
    base = regression.fit({})
    residuals = regression.residual(base), regression.residual(analysis.fit)
    with styled():
        return [
            _force(stem, analysis, base),
            _over_time(stem, analysis, residuals),
            _over_motion(stem, analysis, residuals),
            _spectrum(stem, analysis, residuals),
        ]


def _force(stem: str, analysis: Analysis, base: Fit) -> Drawing:
    signals, regression = analysis.regression.signals, analysis.regression
    rows = signals.rows
    figure = new_figure(3.0)
    axes = figure.subplots()
    axes.set_ylim(*_span(signals.force[rows]))
    plot(axes, signals.t[rows], regression.predicted(base)[rows], ORANGE, "simulation: mass, damper, spring")
    plot(axes, signals.t[rows], signals.force[rows], BLACK, "measured", width=1.6)
    plot(axes, signals.t[rows], regression.predicted(analysis.fit)[rows], BLUE, "extended")
    _finish(axes, "time in s", "force in N")
    title = "Force"
    words = f"Below {signals.cutoff_hz:.0f} Hz, the band in which motion and force are compared."
    return Drawing(title, words, to_svg(figure, f"{stem} {title}", title))


def _over_time(stem: str, analysis: Analysis, residuals: tuple[Floats, Floats]) -> Drawing:
    signals = analysis.regression.signals
    rows = signals.rows
    figure = new_figure(2.6)
    axes = figure.subplots()
    axes.set_ylim(*_span(residuals[0][rows]))
    plot(axes, signals.t[rows], residuals[0][rows], ORANGE, "before")
    plot(axes, signals.t[rows], residuals[1][rows], BLUE, "after")
    _finish(axes, "time in s", "residual in N")
    title = "What is left over time"
    words = f"Measured less modelled force; {analysis.noise_floor_n():.3g} N is noise."
    return Drawing(title, words, to_svg(figure, f"{stem} {title}", title))


def _over_motion(stem: str, analysis: Analysis, residuals: tuple[Floats, Floats]) -> Drawing:
    signals, motion = analysis.regression.signals, analysis.regression.motion({})
    columns = {
        "position in m": motion.x,
        "speed in m/s": motion.v,
        "distance since reversal in m, signed": since_reversal(motion) * motion.direction,
    }
    figure = new_figure(3.0)
    for axes, (label, fine) in zip(figure.subplots(1, 3, sharey=True), columns.items(), strict=True):
        values = np.interp(signals.t, signals.fine_t, fine)[signals.rows]
        step = max(1, len(values) // _POINTS)
        for residual, colour, name in zip(residuals, (ORANGE, BLUE), ("before", "after"), strict=True):
            kept = residual[signals.rows]
            axes.plot(values[::step], kept[::step], ".", color=colour, markersize=1.5, alpha=0.35)
            axes.plot(*_means(values, kept), color=colour, linewidth=2.0, label=name)
        _finish(axes, label, "residual in N")
    title = "What is left over the motion"
    words = "Points and their means in bins of equal count: what stays zero is explained."
    return Drawing(title, words, to_svg(figure, f"{stem} {title}", title))


def _spectrum(stem: str, analysis: Analysis, residuals: tuple[Floats, Floats]) -> Drawing:
    signals = analysis.regression.signals
    piece = max(signals.piecewise(fine=False), key=lambda p: p.stop - p.start)
    rate = signals.coarse_rate_hz
    figure = new_figure(2.6)
    axes = figure.subplots()
    for residual, colour, name in zip(residuals, (ORANGE, BLUE), ("before", "after"), strict=True):
        kept = np.where(signals.rows[piece], residual[piece], 0.0)
        frequency, power = welch(kept, rate, nperseg=min(len(kept), int(8 * rate)))
        inside = (frequency > 0.0) & (frequency < 0.75 * signals.cutoff_hz)
        axes.loglog(frequency[inside], np.sqrt(power[inside]), color=colour, label=name)
    _finish(axes, "frequency in Hz", "residual in N/√Hz")
    title = "Spectrum of what is left"
    return Drawing(
        title, "Lines are periodic; noise is flat or falls.", to_svg(figure, f"{stem} {title}", title)
    )


def _means(values: Floats, residual: Floats) -> tuple[Floats, Floats]:
    order = np.argsort(values, kind="stable")
    parts = np.array_split(order, _BINS)
    return np.array([values[p].mean() for p in parts]), np.array([residual[p].mean() for p in parts])


def _span(values: Floats) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * ((high - low) or 1.0)
    return low - margin, high + margin


def _finish(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.margins(x=0.01)
    axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0, 1), borderpad=0)
