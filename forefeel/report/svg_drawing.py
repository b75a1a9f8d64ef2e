"""The figures of all pages: axes with units, series, points, bars, shaded bands. A figure ends as inline SVG,
the same bytes for the same figure.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from forefeel.common.error_size import Floats
from forefeel.report.wording import scale

BLACK, ORANGE, SKY, GREEN = "#1a1a1a", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE, GREY = "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#b8bec6"
"""Okabe and Ito's palette, which readers with any colour vision can tell apart; and a grey."""

BINS = 1000
"""Longer traces are drawn as smallest and largest value in each of so many stretches of time."""

_GAP_S = 0.25  # a longer pause between two samples interrupts the line
_FAR = 1e99  # of a model that ran away; its square is still a number
_POINTS = 700  # of a cloud; more would only fill the file
_MEANS = 28  # bins of `means`
_WIDTH_IN = 11.0  # of the page
_STYLE: Any = {
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.edgecolor": "#8a939e",
    "axes.labelcolor": "#3c4450",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e9ee",
    "grid.linewidth": 0.7,
    "xtick.color": "#8a939e",
    "ytick.color": "#8a939e",
    "xtick.labelcolor": "#3c4450",
    "ytick.labelcolor": "#3c4450",
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "legend.borderpad": 0.0,
    "legend.columnspacing": 1.3,
    "svg.fonttype": "none",
    "text.parse_math": False,
}
_GROUP_ID = re.compile(r'<g id="[^"]*"')
_HEAD = re.compile(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>')
_SPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


@dataclass(frozen=True, slots=True)
class Drawing:
    """One figure of a page: title, caption, and an `<svg>` element."""

    title: str
    caption: str
    svg: str


@contextmanager
def styled() -> Iterator[None]:
    """Where figures are built and turned into SVG, as a context or a decorator; a trace may have run away."""
    with mpl.rc_context(_STYLE), np.errstate(over="ignore", invalid="ignore"):
        yield


def new_figure(height_in: float, width_in: float = _WIDTH_IN) -> Figure:
    """A figure, transparent; by default of the page's width."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="none")
    FigureCanvasSVG(figure)
    return figure


def one_plot(height_in: float, width_in: float = _WIDTH_IN) -> tuple[Figure, Axes]:
    figure = new_figure(height_in, width_in)
    return figure, figure.subplots()


def drawn(figure: Figure, name: str, title: str, caption: str) -> Drawing:
    """The finished figure; `name` and `title` together set its ids apart from those of others on the page."""
    return Drawing(title, caption, _svg(figure, f"{name} {title}", title))


def _svg(figure: Figure, name: str, label: str) -> str:
    """An `<svg>` element that scales with the page."""
    text = StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with mpl.rc_context({"svg.hashsalt": f"forefeel {name}"}):
        figure.savefig(text, format="svg", metadata=nothing, facecolor="none")
    svg = text.getvalue()
    svg = _GROUP_ID.sub("<g", svg[svg.index("<svg ") :])
    return _HEAD.sub(
        lambda found: f'<svg {_SPACES} {found[1]} role="img" aria-label="{escape(label)}">', svg, count=1
    )


class AxisUnit:
    """What one axis shows, with the prefix that suits what is drawn: `AxisUnit("force", "N", values)`."""

    def __init__(self, label: str, unit: str, *values: Floats) -> None:
        largest = max((float(np.max(np.abs(v), initial=0.0)) for v in values), default=0.0)
        self._factor, prefixed = scale(unit, largest)
        self.label = f"{label} in {prefixed}"

    def __call__(self, values: Floats | float) -> Floats:
        return np.asarray(values, dtype=np.float64) * self._factor


def thin(time_s: Floats, values: Floats, gap_s: float = _GAP_S) -> tuple[Floats, Floats]:
    """The trace as a line of about 2 BINS points at most that keeps every peak.

    NaN interrupts the line, and so does a pause over `gap_s`.
    """
    order = np.argsort(time_s, kind="stable")
    time_s, values = time_s[order], values[order]
    pauses = np.flatnonzero(np.diff(time_s) > gap_s) + 1
    time_s = np.insert(time_s, pauses, (time_s[pauses - 1] + time_s[pauses]) / 2)
    values = np.insert(values, pauses, np.nan)
    if len(time_s) <= 2 * BINS:
        return time_s, values
    bins = np.minimum((time_s - time_s[0]) / (time_s[-1] - time_s[0]) * BINS, BINS - 1).astype(np.int64)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    return np.repeat(time_s[starts], 2), np.column_stack((low, high)).ravel()


def limit_y(
    axes: Axes, *traces: Floats, beside: Floats | None = None, trim: float = 0.0, zero: bool = False
) -> None:
    """Limits the y axis to the traces; to `beside` too, but by two spans of the others at most.

    Each trace's lowest and highest values, a share `trim`, do not count. `zero`: it is in the picture.
    """
    ends = [found for trace in traces if (found := _ends(trace, trim))]
    if not ends:
        return
    ends += [(0.0, 0.0)] if zero else []
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    span = (high - low) or 0.1 * abs(high) or 1.0
    more = None if beside is None else _ends(beside, trim)
    if more:
        low, high = min(low, max(more[0], low - 2 * span)), max(high, min(more[1], high + 2 * span))
    axes.set_ylim(low - 0.06 * span, high + 0.06 * span)


def _ends(trace: Floats, trim: float) -> tuple[float, float] | None:
    known = trace[np.isfinite(trace)]
    if not len(known):
        return None
    low, high = np.quantile(known.clip(-_FAR, _FAR), (trim, 1 - trim)).tolist()
    return low, high


def plot(
    axes: Axes,
    time_s: Floats,
    values: Floats,
    colour: str,
    label: str,
    width: float = 1.1,
    gap_s: float = _GAP_S,
) -> None:
    """Draws a trace, thinned; it goes just out of the picture where it is beyond the limits."""
    low, high = axes.get_ylim()
    span = high - low
    x, y = thin(time_s, values, gap_s)
    axes.plot(x, np.clip(y, low - span, high + span), color=colour, label=label, linewidth=width)


def band(
    axes: Axes,
    time_s: Floats,
    low: Floats,
    high: Floats,
    label: str | None = None,
    gap_s: float = _GAP_S,
) -> None:
    """Shades what lies between two traces, within the limits of the picture."""
    if not np.isfinite(low).any():
        return
    floor, ceiling = axes.get_ylim()
    x, below = thin(time_s, np.clip(low, floor, ceiling), gap_s)
    _, above = thin(time_s, np.clip(high, floor, ceiling), gap_s)
    axes.fill_between(x, below, above, color=SKY, alpha=0.4, linewidth=0, label=label)


def band_about_zero(axes: Axes, size: float, label: str) -> None:
    """Shades from -size to size: what is small enough."""
    axes.axhspan(-size, size, color=GREY, alpha=0.35, linewidth=0, label=label)


def cloud(axes: Axes, x: Floats, y: Floats, colour: str, size: float = 1.6) -> None:
    """At most _POINTS points, evenly taken."""
    step = max(1, len(x) // _POINTS)
    axes.plot(x[::step], y[::step], ".", color=colour, markersize=size, alpha=0.4, zorder=2)


def means(x: Floats, y: Floats, bins: int = _MEANS) -> tuple[Floats, Floats]:
    """(mean of x, mean of y) in bins along x."""
    parts = _binned(x, bins)
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts])


def medians(x: Floats, y: Floats, bins: int) -> tuple[Floats, Floats]:
    """As `means`, of a curve with a few points beside it."""
    parts = _binned(x, bins)
    return np.array([np.median(x[part]) for part in parts]), np.array([np.median(y[part]) for part in parts])


def _binned(x: Floats, bins: int) -> list[NDArray[np.intp]]:
    """The rows of each bin that has some; half of the edges at equal counts, half at equal distances."""
    if not len(x):
        return []
    inner = np.linspace(0.0, 1.0, bins // 2 + 1)[1:-1]
    edges = np.sort(np.concatenate([np.quantile(x, inner), x.min() + inner * np.ptp(x)]))
    order = np.argsort(x, kind="stable")
    parts = np.split(order, np.searchsorted(x[order], edges))
    return [part for part in parts if len(part)]


def bars(axes: Axes, labels: Sequence[str], sizes: Sequence[float], colours: Sequence[str]) -> None:
    """One horizontal bar in N for each, the first on top, its size beside it."""
    unit = AxisUnit("rms", "N", np.array(sizes))
    places = np.arange(len(labels))[::-1]
    axes.barh(places, unit(np.array(sizes)), color=list(colours), height=0.62)
    for place, size in zip(places, sizes, strict=True):
        axes.text(float(unit(size)), float(place), f" {float(unit(size)):.3g}", va="center", fontsize=9.5)
    axes.set_yticks(places, list(labels))
    axes.set_xlabel(unit.label)
    axes.grid(False, axis="y")
    axes.margins(x=0.08)


def finish(axes: Axes, x: str, y: str, columns: int = 4, legend: bool = True, margin: float = 0.01) -> None:
    """Labels, and the legend above the axes, where it hides nothing."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.margins(x=margin)
    if legend and axes.get_legend_handles_labels()[0]:
        axes.legend(ncols=columns, loc="lower left", bbox_to_anchor=(0, 1))


def common_legend(figure: Figure, axes: Axes) -> None:
    """That of one of several pictures for all of them, above."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, ncols=4, loc="outside upper left")


def plain_numbers(*axes: Axis) -> None:
    """At a logarithmic axis: 0.01, 1, 100 in place of powers."""
    for axis in axes:
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
