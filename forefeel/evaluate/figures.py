"""The figures of an evaluation: measured, predicted with its band, held."""

import numpy as np
from matplotlib.axes import Axes

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import GAP_S
from forefeel.diagnosis.evaluation.evaluate import Evaluated
from forefeel.report.svg import (
    BLACK,
    BLUE,
    ORANGE,
    SKY,
    Drawing,
    limit_y,
    new_figure,
    plot,
    styled,
    thin,
    to_svg,
)

_WORST_S = 6.0
_TYPICAL_S = 10.0
_TRIM = 0.001
_LIMITS = "Values far beyond the others are cut off at the edge of the picture."


def drawings(stem: str, evaluated: Evaluated) -> list[Drawing]:
    """Around the worst error, a typical stretch, the error over time."""
    worst_s, typical_s = worst_stamp(evaluated), typical_start(evaluated)
    with styled(), np.errstate(over="ignore", invalid="ignore"):  # of a method that ran away
        return [
            _forces(
                stem,
                evaluated,
                (worst_s - _WORST_S / 2, worst_s + _WORST_S / 2),
                "Around the worst error",
                f"The largest scored error of forefeel, at {worst_s:.2f} s. {_LIMITS}",
            ),
            _forces(
                stem,
                evaluated,
                (typical_s, typical_s + _TYPICAL_S),
                f"A typical {_TYPICAL_S:g} s",
                "The stretch whose rms error of forefeel is the median of all such stretches.",
            ),
            _errors(stem, evaluated),
        ]


def worst_stamp(evaluated: Evaluated) -> float:
    """When forefeel's scored error is largest, in s after the first stamp."""
    size = np.where(evaluated.prepared.rows, _squared_errors(evaluated), -1.0)
    return float(_time_s(evaluated)[int(np.argmax(size))])


def typical_start(evaluated: Evaluated) -> float:
    """Start of the stretch of 10 s, of those one after the other, with forefeel's median rms error."""
    time_s, rows = _time_s(evaluated), evaluated.prepared.rows
    squares = _squared_errors(evaluated)
    first_s = float(time_s[rows][0])
    stretch = np.floor((time_s[rows] - first_s) / _TYPICAL_S).astype(np.int64)
    known = np.unique(stretch)
    known = known[:-1] if len(known) > 1 else known  # the last one is cut short
    means = np.array([np.mean(squares[rows][stretch == number]) for number in known])
    middle = known[np.argsort(means)[(len(known) - 1) // 2]]
    return first_s + _TYPICAL_S * float(middle)


def _squared_errors(evaluated: Evaluated) -> Floats:
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (evaluated.said_n["forefeel"] - evaluated.prepared.force_n) ** 2
    return np.nan_to_num(squares, nan=np.finfo(np.float64).max)


def _time_s(evaluated: Evaluated) -> Floats:
    time_s = evaluated.prepared.recording.time_s
    return np.asarray(time_s - time_s[0])


def _forces(
    stem: str, evaluated: Evaluated, span_s: tuple[float, float], title: str, caption: str
) -> Drawing:
    time_s = _time_s(evaluated)
    rows = (time_s >= span_s[0]) & (time_s <= span_s[1])
    held_n, said_n = evaluated.said_n["hold"][rows], evaluated.said_n["forefeel"][rows]
    force_n, trace = evaluated.prepared.force_n[rows], evaluated.traces["forefeel"]
    figure = new_figure(3.3)
    axes = figure.subplots()
    limit_y(axes, held_n, force_n, beside=said_n, trim=_TRIM)
    _band(axes, time_s[rows], trace.low_n[rows], trace.high_n[rows])
    plot(axes, time_s[rows], held_n, ORANGE, "hold", gap_s=GAP_S)
    plot(axes, time_s[rows], force_n, BLACK, "measured", width=1.7, gap_s=GAP_S)
    plot(axes, time_s[rows], said_n, BLUE, "forefeel", gap_s=GAP_S)
    _finish(axes, "force in N")
    return Drawing(title, caption, to_svg(figure, f"{stem} {title}", f"{stem}: {title}"))


def _band(axes: Axes, time_s: Floats, low_n: Floats, high_n: Floats) -> None:
    if not np.isfinite(low_n).any():
        return
    floor, ceiling = axes.get_ylim()
    x, below = thin(time_s, np.clip(low_n, floor, ceiling), gap_s=GAP_S)
    _, above = thin(time_s, np.clip(high_n, floor, ceiling), gap_s=GAP_S)
    axes.fill_between(x, below, above, color=SKY, alpha=0.4, linewidth=0, label="95 % band")


def _errors(stem: str, evaluated: Evaluated) -> Drawing:
    rows, force_n = evaluated.prepared.rows, evaluated.prepared.force_n
    time_s = _time_s(evaluated)[rows]
    held_n, said_n = ((evaluated.said_n[name] - force_n)[rows] for name in ("hold", "forefeel"))
    figure = new_figure(3.0)
    axes = figure.subplots()
    limit_y(axes, held_n, beside=said_n, trim=_TRIM)
    plot(axes, time_s, held_n, ORANGE, "hold - measured", gap_s=GAP_S)
    plot(axes, time_s, said_n, BLUE, "forefeel - measured", gap_s=GAP_S)
    _finish(axes, "error in N")
    title = "Error over time"
    return Drawing(title, f"All scored stamps. {_LIMITS}", to_svg(figure, f"{stem} {title}", title))


def _finish(axes: Axes, y: str) -> None:
    axes.set_ylabel(y)
    axes.set_xlabel("time in s")
    axes.margins(x=0.01)
    axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0, 1), borderpad=0)
