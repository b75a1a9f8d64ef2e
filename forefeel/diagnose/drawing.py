"""What the figures of a diagnosis share: scaled axes, clouds of points with their means, limits."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from scipy.signal import welch

from forefeel.common.error_size import Floats
from forefeel.diagnose.parts import Rows
from forefeel.diagnose.units import scale
from forefeel.diagnosis.diagnose.signals import Signals
from forefeel.report.svg import Drawing, to_svg

POINTS = 700
BINS = 28
_SHARE = 0.002


class Axis:
    """A quantity of one axis, with the prefix that suits what is drawn: `Axis("force", "N", values)`."""

    def __init__(self, label: str, unit: str, *values: Floats) -> None:
        largest = max((float(np.max(np.abs(v), initial=0.0)) for v in values), default=0.0)
        self._factor, prefixed = scale(unit, largest)
        self.label = f"{label} in {prefixed}"

    def __call__(self, values: Floats | float) -> Floats:
        """In the unit of the label."""
        return np.asarray(values, dtype=np.float64) * self._factor


def cloud(axes: Axes, x: Floats, y: Floats, colour: str, size: float = 1.6) -> None:
    """At most POINTS points, evenly taken."""
    step = max(1, len(x) // POINTS)
    axes.plot(x[::step], y[::step], ".", color=colour, markersize=size, alpha=0.4, zorder=2)


def means(x: Floats, y: Floats, bins: int = BINS) -> tuple[Floats, Floats]:
    """(mean of x, mean of y) in bins along x."""
    parts = _binned(x, bins)
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts])


def medians(x: Floats, y: Floats, bins: int) -> tuple[Floats, Floats]:
    """As `means`, of a curve with a few points beside it."""
    parts = _binned(x, bins)
    return np.array([np.median(x[part]) for part in parts]), np.array([np.median(y[part]) for part in parts])


def _binned(x: Floats, bins: int) -> list[Rows]:
    """The rows of each bin that has some; half of the edges at equal counts, half at equal distances."""
    inner = np.linspace(0.0, 1.0, bins // 2 + 1)[1:-1]
    edges = np.sort(np.concatenate([np.quantile(x, inner), x.min() + inner * np.ptp(x)]))
    order = np.argsort(x, kind="stable")
    parts = np.split(order, np.searchsorted(x[order], edges))
    return [part for part in parts if len(part)]


def span(axes: Axes, *values: Floats, least: float = 0.0) -> None:
    """Limits y to the values but for their outermost share; what is beyond is not drawn."""
    ends = np.array([np.quantile(v, (_SHARE, 1.0 - _SHARE)) for v in values if len(v)])
    low, high = min(float(ends[:, 0].min()), -least), max(float(ends[:, 1].max()), least)
    margin = 0.08 * ((high - low) or 1.0)
    axes.set_ylim(low - margin, high + margin)


def density(signals: Signals, values: Floats, longest_s: float = 8.0) -> tuple[Floats, Floats]:
    """(Hz, amplitude density in N/sqrt(Hz)) of the longest stretch without gaps, within the pass-band."""
    piece = max(signals.piecewise(fine=False), key=lambda p: p.stop - p.start)
    rate = signals.coarse_rate_hz
    kept = np.where(signals.rows[piece], values[piece], 0.0)
    frequency, power = welch(kept, rate, nperseg=min(len(kept), int(longest_s * rate)))
    inside = (frequency > 0.0) & (frequency < 0.75 * signals.cutoff_hz)
    return frequency[inside], np.sqrt(power[inside])


def finish(axes: Axes, x: str, y: str, legend: bool = True) -> None:
    """Labels, and the legend above."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.margins(x=0.01)
    if legend:
        axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0, 1), borderpad=0, handlelength=1.4)


def common_legend(figure: Figure, axes: Axes) -> None:
    """That of one of several pictures for all of them, above."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, ncols=4, loc="outside upper left", borderpad=0, handlelength=1.4)


def drawn(figure: Figure, name: str, title: str, caption: str) -> Drawing:
    """The finished figure; `name` sets it apart from others of the page."""
    return Drawing(title, caption, to_svg(figure, f"{name} {title}", title))


def logarithmic(axes: Axes, x: bool = True) -> None:
    """Logarithmic axes with plain numbers on them."""
    for axis in (axes.xaxis, axes.yaxis) if x else (axes.yaxis,):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def bars(axes: Axes, labels: Sequence[str], sizes: Sequence[float], colours: Sequence[str]) -> None:
    """One horizontal bar for each, the first on top, its size beside it."""
    axis = Axis("rms", "N", np.array(sizes))
    places = np.arange(len(labels))[::-1]
    axes.barh(places, axis(np.array(sizes)), color=list(colours), height=0.62)
    for place, size in zip(places, sizes, strict=True):
        axes.text(float(axis(size)), float(place), f" {float(axis(size)):.3g}", va="center", fontsize=9.5)
    axes.set_yticks(places, list(labels))
    axes.set_xlabel(axis.label)
    axes.grid(False, axis="y")
    axes.margins(x=0.08)
