"""Figures of all pages as data: a page carries each as JSON, and chart.js of the live page draws it.

    lines = [line("felt", "felt", t_s, a_n, GAP_S), line("measured", "measured", t_s, b_n, GAP_S, **DOTTED)]
    above = panel("force, N", limits(a_n, b_n, trim=0.002), lines=lines, weight=3)
    Figure("Force", "What it shows.", 360, (spec([above, below], unit="s"),))

A `spec` is one canvas: panels one above the other, on one axis of x. The `specs` of a figure stand side by
side. The macro `picture` of parts.html.j2 shows a figure. Colours are names of theme.css: predicted, late,
measured, felt, readback, good, warn, bad, ink, soft. What else a layer may have (width, dash, alpha, digits),
and `spans` and `rules` of a panel, stand at the head of chart.js and are passed on as they are.
Numbers are rounded to what a pixel shows, also where a part is enlarged 20 times; NaN breaks a line. So a
file stays small, and the same recording gives the same bytes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, isfinite, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import Floats
from forefeel.report.wording import scale

Layer = dict[str, Any]
"""Lines, points or a band of a panel; its `rows` are an array until `spec` rounds it."""
Range = dict[str, Any]

DASHED: Layer = {"dash": [7, 5]}
DOTTED: Layer = {"dash": [0.1, 5], "width": 2.4}
GAP_S = 0.25
"""A longer pause between two samples interrupts a line along time."""
BINS = 2500
"""Of a longer line the smallest and the largest value in each of so many stretches of x."""

_FAR = 1e99  # of a model that ran away; its square is still a number
_POINTS = 700  # of a cloud; more would only fill the file
_LAYERS = "lines", "points", "bands"  # of a panel, with rows of x and y
_STEPS = 20_000  # of a range, to which numbers are rounded


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of a page: each of its `specs` is drawn in a canvas of its own, `height_px` high."""

    title: str
    caption: str
    height_px: int
    specs: tuple[Layer, ...]


class AxisUnit:
    """Label and scale of an axis, with the prefix that suits the values: `AxisUnit("force", "N", values)`."""

    def __init__(self, label: str, unit: str, *values: Floats) -> None:
        largest = max((float(np.max(np.abs(v), initial=0.0)) for v in values), default=0.0)
        self._factor, prefixed = scale(unit, largest)
        self.label = f"{label}, {prefixed}"

    def __call__(self, values: Floats | float) -> Floats:
        return np.asarray(values, dtype=np.float64) * self._factor


def line(name: str, colour: str, x: Floats, y: Floats, gap: float = np.inf, **more: object) -> Layer:
    """A line along ascending x, thinned; a pause over `gap` in x interrupts it."""
    return {"name": name, "colour": colour, "rows": thin(x, gap, y), **more}


def loop(name: str, colour: str, x: Floats, y: Floats, **more: object) -> Layer:
    """A line whose x goes back and forth; hover reads nothing from it."""
    step = -(-len(x) // (2 * BINS)) or 1
    rows = np.column_stack((x, y))[::step]
    return {"name": name, "colour": colour, "free": True, "rows": rows, **more}


def band(
    name: str, colour: str, x: Floats, low: Floats, high: Floats, gap: float = np.inf, alpha: float = 0.26
) -> Layer:
    return {"name": name, "colour": colour, "alpha": alpha, "rows": thin(x, gap, low, high)}


def cloud(name: str, colour: str, x: Floats, y: Floats, **more: object) -> Layer:
    """At most _POINTS points, evenly taken."""
    step = max(1, len(x) // _POINTS)
    return {"name": name, "colour": colour, "rows": np.column_stack((x, y))[::step], **more}


def panel(title: str, y: Range | None = None, **more: object) -> Layer:
    """Layers on one axis of y: `lines`, `points`, `bands`, `spans`, `rules`, lists of them.

    `y`: its `limits`, which may have `log` too; without, what the lines need. `weight`: share of the height.
    """
    return {"title": title, **({"y": y} if y else {}), **more}


def spec(panels: Sequence[Layer], ends: tuple[float, float] | None = None, **x: object) -> Layer:
    """Canvas as plain data for JSON: panels, their rows rounded, on one axis of x. `ends` of x, else those of
    the layers, else 0 to 1; `x`: what else the axis has: label, unit, log.
    """
    columns = [layer["rows"][:, 0] for of in panels for kind in _LAYERS for layer in of.get(kind, ())]
    low, high = ends or _ends(np.concatenate([np.empty(0), *columns]), 0.0) or (0.0, 1.0)
    high = high if high > low else low + 1.0
    places = None if x.get("log") else _places(high - low)
    low, high = (end if places is None else round(end, places) for end in (low, high))
    return {"x": {"min": low, "max": high, **x}, "panels": [_rounded(of, places) for of in panels]}


def limits(
    *traces: Floats, beside: Floats | None = None, trim: float = 0.0, zero: bool = False
) -> Range | None:
    """Limits of y, rounded, that hold the traces with a margin of 6 %; `beside` too, but by two spans of the
    others at most.

    Each trace's lowest and highest values, a share `trim`, do not count. `zero`: it is in the picture. None:
    there is no value.
    """
    ends = [pair for trace in traces if (pair := _ends(trace, trim))]
    if not ends:
        return None
    ends += [(0.0, 0.0)] if zero else []
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    span = (high - low) or 0.1 * abs(high) or 1.0
    more = None if beside is None else _ends(beside, trim)
    if more:
        low, high = min(low, max(more[0], low - 2 * span)), max(high, min(more[1], high + 2 * span))
    places = _places(span)
    return {"min": round(low - 0.06 * span, places), "max": round(high + 0.06 * span, places)}


def thin(x: Floats, gap: float, *columns: Floats) -> Floats:
    """Rows of x and the columns, sorted by x; where they are more than 2 BINS, only the extremes of each of
    BINS bins.

    Of one column each bin keeps the lowest and the highest value, of two the first's lowest and the second's
    highest. NaN breaks a line; a row of NaN is added at a pause over `gap`.
    """
    order = np.argsort(x, kind="stable")
    x, values = x[order], np.column_stack(columns)[order]
    pauses = np.flatnonzero(np.diff(x) > gap) + 1
    x = np.insert(x, pauses, (x[pauses - 1] + x[pauses]) / 2)
    values = np.insert(values, pauses, np.nan, axis=0)
    if len(x) <= 2 * BINS:
        return np.column_stack((x, values))
    bins = np.minimum((x - x[0]) / (x[-1] - x[0]) * BINS, BINS - 1).astype(np.int64)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    low, high = np.fmin.reduceat(values[:, 0], starts), np.fmax.reduceat(values[:, -1], starts)
    if len(columns) > 1:
        return np.column_stack((x[starts], low, high))
    return np.column_stack((np.repeat(x[starts], 2), np.column_stack((low, high)).ravel()))


def binned(
    x: Floats, y: Floats, bins: int = 28, of: Callable[[Floats], Any] = np.mean
) -> tuple[Floats, Floats]:
    """Means of x and y in up to `bins` bins along x; `of`: in place of the mean, such as np.median."""
    parts = _binned(x, bins)
    return np.array([of(x[part]) for part in parts]), np.array([of(y[part]) for part in parts])


def _binned(x: Floats, bins: int) -> list[NDArray[np.intp]]:
    """Rows of each bin that has some, as indices into x (finite), bins by ascending x; half of the edges
    at equal counts, half at equal distances. Empty without values.
    """
    if not len(x):
        return []
    inner = np.linspace(0.0, 1.0, bins // 2 + 1)[1:-1]
    edges = np.sort(np.concatenate([np.quantile(x, inner), x.min() + inner * np.ptp(x)]))
    order = np.argsort(x, kind="stable")
    parts = np.split(order, np.searchsorted(x[order], edges))
    return [part for part in parts if len(part)]


def _ends(trace: Floats, trim: float) -> tuple[float, float] | None:
    """Quantiles `trim` and 1 - `trim` of the finite values; None without any."""
    known = trace[np.isfinite(trace)]
    if not len(known):
        return None
    low, high = np.quantile(known.clip(-_FAR, _FAR), (trim, 1 - trim)).tolist()
    return low, high


def _rounded(of: Layer, x_places: int | None) -> Layer:
    """Copy of a panel with lists for arrays; values over a span beyond its limits are clipped."""
    y, made = of.get("y", {}), dict(of)
    for kind in _LAYERS:
        if kind in of:
            made[kind] = [{**layer, "rows": _rows(layer["rows"], x_places, y)} for layer in of[kind]]
    return made


def _rows(rows: Floats, x_places: int | None, y: Range) -> list[tuple[float | None, ...]]:
    """Rounded rows as tuples for JSON, None for NaN. Values further than one span beyond the limits in `y`
    are clipped; without limits their own ends stand for them. `x_places`: decimals of x, None: four digits.
    """
    values = rows[:, 1:]
    low, high = (y["min"], y["max"]) if "min" in y else _ends(values.ravel(), 0.0) or (0.0, 1.0)
    values = values.clip(2 * low - high, 2 * high - low)
    places = None if y.get("log") else _places(high - low)
    columns = [_column(rows[:, 0], x_places), *(_column(column, places) for column in values.T)]
    return list(zip(*columns, strict=True))


def _column(values: Floats, places: int | None) -> list[float | None]:
    """Values rounded to so many places behind the point, or to four digits; None for NaN."""
    if places is None:
        return [float(f"{value:.4g}") if isfinite(value) else None for value in values.tolist()]
    return [value if isfinite(value) else None for value in (np.round(values, places) + 0.0).tolist()]


def _places(span: float) -> int:
    return max(0, ceil(-log10(span / _STEPS))) if span > 0 else 9
