"""How the figures look, and their way into a page: inline SVG, the same bytes for the same figure."""

import re
from contextlib import AbstractContextManager
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from forefeel.common.error_size import Floats

BLACK, ORANGE, SKY, GREEN = "#1a1a1a", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE, GREY = "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#b8bec6"
"""Okabe and Ito's palette, which readers with any colour vision can tell apart; and a grey."""

BINS = 1000
"""Longer traces are drawn as smallest and largest value in each of so many stretches of time."""

_GAP_S = 0.25
_FAR = 1e99  # of a model that ran away; its square is still a number
_WIDTH_IN = 11.0
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
    "svg.fonttype": "none",
    "text.parse_math": False,
}
_GROUP_ID = re.compile(r'<g id="[^"]*"')
_HEAD = re.compile(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>')
_SPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


@dataclass(frozen=True, slots=True)
class Drawing:
    """One figure of the page: title, caption, and an `<svg>` element."""

    title: str
    caption: str
    svg: str


def styled() -> AbstractContextManager[None]:
    """Where a figure is built and turned into SVG."""
    return mpl.rc_context(_STYLE)


def new_figure(height_in: float, width_in: float = _WIDTH_IN) -> Figure:
    """A figure, transparent; by default of the page's width."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="none")
    FigureCanvasSVG(figure)
    return figure


def to_svg(figure: Figure, name: str, title: str) -> str:
    """The figure as an `<svg>` element that scales with the page; `name` sets its ids apart."""
    text = StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with mpl.rc_context({"svg.hashsalt": f"forefeel {name}"}):
        figure.savefig(text, format="svg", metadata=nothing, facecolor="none")
    svg = text.getvalue()
    svg = _GROUP_ID.sub("<g", svg[svg.index("<svg ") :])

    return _HEAD.sub(
        lambda found: f'<svg {_SPACES} {found[1]} role="img" aria-label="{escape(title)}">', svg, count=1
    )


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


def limit_y(axes: Axes, *traces: Floats, beside: Floats | None = None, trim: float = 0.0) -> None:
    """Limits the y axis to the traces; to `beside` too, but by two spans of the others at most.

    Each trace's lowest and highest values, a share `trim`, do not count.
    """
    ends = [found for trace in traces if (found := _ends(trace, trim))]
    if not ends:
        return
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
