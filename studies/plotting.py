"""Figures for the paper, as matplotlib draws them: the extra `plot`. A page of the product draws its own."""

from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forefeel.common.error_size import Floats
from forefeel.report.drawing import limits

BLACK, ORANGE, SKY = "#1a1a1a", "#E69F00", "#56B4E9"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#b8bec6"
"""Okabe and Ito's palette, which readers with any colour vision can tell apart; and a grey."""

_STYLE: Any = {
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e9ee",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.columnspacing": 1.3,
}


def styled() -> AbstractContextManager[None]:
    """Where figures are built and saved."""
    return mpl.rc_context(_STYLE)


def new_figure(height_in: float) -> Figure:
    return Figure(figsize=(11.0, height_in), layout="constrained")


def limit_y(axes: Axes, *traces: Floats, beside: Floats | None = None, trim: float = 0.0) -> None:
    if found := limits(*traces, beside=beside, trim=trim):
        axes.set_ylim(found["min"], found["max"])


def plot(axes: Axes, time_s: Floats, values: Floats, colour: str, label: str, width: float = 1.1) -> None:
    """A trace; it goes just out of the picture where it is beyond the limits."""
    low, high = axes.get_ylim()
    clipped = np.clip(values, 2 * low - high, 2 * high - low)
    axes.plot(time_s, clipped, color=colour, label=label, linewidth=width)


def finish(axes: Axes, x: str, y: str, columns: int = 4) -> None:
    """Labels, and the legend above the axes, where it hides nothing."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.margins(x=0.01)
    axes.legend(ncols=columns, loc="lower left", bbox_to_anchor=(0, 1))
