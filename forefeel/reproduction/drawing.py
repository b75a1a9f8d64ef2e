"""One figure as PNG and as inline SVG, and what all figures have in common."""

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forefeel.report.svg import new_figure, styled, to_svg

_DPI = 120
FAR = 1e300


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure of the page: its file, title, caption, and both forms."""

    name: str
    title: str
    caption: str
    svg: str
    png: bytes

    @property
    def file(self) -> str:
        """The name of its PNG."""
        return f"{self.name}.png"


def picture(name: str, title: str, caption: str, height_in: float, draw: Callable[[Figure], None]) -> Picture:
    """Draws on a fresh figure of the page's width."""
    with styled(), np.errstate(over="ignore", invalid="ignore"):  # of what diverged
        figure = new_figure(height_in)
        draw(figure)
        svg = to_svg(figure, name, title)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11)  # the page has it above the figure
        png = BytesIO()
        figure.savefig(png, format="png", dpi=_DPI, facecolor="white", metadata={"Software": None})
        return Picture(name, title, caption, svg, png.getvalue())


def finish(axes: Axes, y: str, x: str, columns: int = 4) -> None:
    """Labels, and the legend above the axes, where it hides nothing."""
    axes.set_ylabel(y)
    axes.set_xlabel(x)
    axes.legend(ncols=columns, loc="lower left", bbox_to_anchor=(0, 1), borderpad=0, columnspacing=1.3)
