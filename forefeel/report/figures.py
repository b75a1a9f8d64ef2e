"""The figures of a report. Each says in its caption what it shows and what it leaves out."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from forefeel.common.error_size import Floats
from forefeel.common.messages import LoopTiming, SafetyState
from forefeel.report.captions import (
    DELAY,
    DETAIL,
    ERROR,
    FORCE,
    LATENESS,
    MOST_PARAMETERS,
    PARAMETERS,
    POSITION,
    STATES,
    TRIM,
)
from forefeel.report.score import scored
from forefeel.report.svg import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
    Drawing,
    limit_y,
    new_figure,
    plot,
    styled,
    thin,
    to_svg,
)
from forefeel.report.traces import AxisTraces, CommandTraces, ParameterTraces

_COLOURS: dict[SafetyState | None, str] = {
    SafetyState.IDLE: GREY,
    SafetyState.READY: SKY,
    SafetyState.ENGAGING: YELLOW,
    SafetyState.ARMED: GREEN,
    SafetyState.STOPPING: ORANGE,
    SafetyState.FAULT: VERMILION,
    SafetyState.ESTOPPED: PURPLE,
    None: "#ffffff",
}
_DETAIL_S = 4.0


Recipe = tuple[Callable[[AxisTraces], Figure | None], str, str]


def axis_drawings(axis: str, traces: AxisTraces) -> list[Drawing]:
    """The figures of one axis; for what was not recorded there is none."""
    with styled(), np.errstate(over="ignore", invalid="ignore"):  # of a model that ran away
        made = [(recipe(traces), title, caption) for recipe, title, caption in _RECIPES]
        return [_drawing(figure, axis, title, caption) for figure, title, caption in made if figure]


def loop_drawings(timings: Mapping[str, LoopTiming | None]) -> list[Drawing]:
    """Lateness of the loops, by role; nothing when neither said anything."""
    known = {role: timing for role, timing in timings.items() if timing and _drawable(timing)}
    if not known:
        return []
    with styled():
        return [_drawing(_lateness(known), "", "Lateness of the 1 kHz loops", LATENESS)]


def _drawing(figure: Figure, axis: str, title: str, caption: str) -> Drawing:
    return Drawing(title, caption, to_svg(figure, f"{axis} {title}", title))


def _force(traces: AxisTraces) -> Figure | None:
    commands = traces.commands
    if not len(commands.time_s):
        return None
    figure = new_figure(4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.3, 1))
    _contact_force(above, commands)
    limit_y(below, commands.rendered_n)
    plot(below, commands.time_s, commands.rendered_n, GREEN, "felt by the hand")
    _finish(below, "force in N")
    _time_axis(below, traces)
    return figure


def _force_detail(traces: AxisTraces) -> Figure | None:
    """A stretch from the middle of what was scored."""
    commands = traces.commands
    times = commands.time_s[scored(commands.predicted_n, commands.held_n, commands.force_n)]
    if not len(times) or np.ptp(commands.time_s) < 2 * _DETAIL_S:
        return None
    start_s = float(np.median(times)) - _DETAIL_S / 2
    rows = np.flatnonzero((commands.time_s >= start_s) & (commands.time_s < start_s + _DETAIL_S))
    columns = {name: getattr(commands, name)[rows] for name in CommandTraces.__dataclass_fields__}
    figure = new_figure(3.3)
    axes = figure.subplots()
    _contact_force(axes, CommandTraces(**columns))
    axes.set_xlabel("time in s")
    return figure


def _contact_force(axes: Axes, commands: CommandTraces) -> None:
    limit_y(axes, commands.held_n, commands.force_n, beside=commands.predicted_n, trim=TRIM)
    if np.isfinite(commands.low_n).any():
        low, high = axes.get_ylim()
        time_s, below = thin(commands.time_s, np.clip(commands.low_n, low, high))
        _, above = thin(commands.time_s, np.clip(commands.high_n, low, high))
        axes.fill_between(time_s, below, above, color=SKY, alpha=0.35, linewidth=0, label="95 % band")
    plot(axes, commands.time_s, commands.held_n, ORANGE, "held (newest that had arrived)")
    plot(axes, commands.time_s, commands.force_n, BLACK, "measured, by command", width=1.7)
    plot(axes, commands.time_s, commands.predicted_n, BLUE, "predicted")
    _finish(axes, "force in N")


def _error(traces: AxisTraces) -> Figure | None:
    commands = traces.commands
    rows = scored(commands.predicted_n, commands.held_n, commands.force_n)
    if not rows.any():
        return None
    held_mn = 1e3 * (commands.held_n - commands.force_n)[rows]
    predicted_mn = 1e3 * (commands.predicted_n - commands.force_n)[rows]
    figure = new_figure(3.0)
    axes = figure.subplots()
    limit_y(axes, held_mn, beside=predicted_mn, trim=TRIM)
    axes.axhline(0, color="#8a939e", linewidth=0.8)
    plot(axes, commands.time_s[rows], held_mn, ORANGE, "held - measured")
    plot(axes, commands.time_s[rows], predicted_mn, BLUE, "predicted - measured")
    _finish(axes, "error in mN")
    _time_axis(axes, traces)
    return figure


def _position(traces: AxisTraces) -> Figure | None:
    commands = traces.commands
    if not len(commands.time_s) and not len(traces.readback_time_s):
        return None
    commanded_mm, readback_mm = 1e3 * commands.position_m, 1e3 * traces.readback_m
    figure = new_figure(2.7)
    axes = figure.subplots()
    limit_y(axes, commanded_mm, readback_mm)
    plot(axes, commands.time_s, commanded_mm, BLUE, "commanded")
    plot(axes, traces.readback_time_s, readback_mm, VERMILION, "read back")
    _finish(axes, "position in mm")
    _time_axis(axes, traces)
    return figure


def _states(traces: AxisTraces) -> Figure | None:
    if not traces.states:
        return None
    figure = new_figure(1.35)
    axes = figure.subplots()
    for state in dict.fromkeys(span.state for span in traces.states):
        bars = [
            ((span.start_ns - traces.start_ns) * 1e-9, (span.end_ns - span.start_ns) * 1e-9)
            for span in traces.states
            if span.state is state
        ]
        axes.broken_barh(bars, (0, 1), facecolor=_COLOURS[state], edgecolor="none")
    axes.set_yticks([])
    axes.set_ylim(0, 1)
    axes.grid(False)
    axes.set_xlim(0, traces.duration_s)
    axes.set_xlabel("time in s")

    patches = [
        Patch(facecolor=_COLOURS[state], edgecolor="#8a939e", linewidth=0.5, label=state or "silent")
        for state in _COLOURS
        if any(span.state is state for span in traces.states)
    ]
    axes.legend(handles=patches, ncols=len(patches), loc="lower left", bbox_to_anchor=(0, 1), borderpad=0)
    return figure


def _delay(traces: AxisTraces) -> Figure | None:
    if not len(traces.delay_s):
        return None
    delay_ms = 1e3 * traces.delay_s
    figure = new_figure(2.5)
    axes = figure.subplots()
    span = float(np.ptp(delay_ms)) or 1.0
    axes.hist(
        delay_ms, bins=60, range=(delay_ms.min() - 0.02 * span, delay_ms.max() + 0.02 * span), color=SKY
    )
    for share, dashes in (0.50, "solid"), (0.99, "dashed"):
        value_ms = float(np.quantile(delay_ms, share))
        label = f"{share:.0%} within {value_ms:.4g} ms"
        axes.axvline(value_ms, color=BLACK, linewidth=1.2, linestyle=dashes, label=label)
    _finish(axes, "commands", "from a command to the arrival of its force, in ms")
    return figure


def _parameters(traces: AxisTraces) -> Figure | None:
    known = traces.parameters
    if known is None:
        return None
    shown = known.names[:MOST_PARAMETERS]
    rows = ceil(len(shown) / 2)
    figure = new_figure(0.6 + 1.55 * rows)
    grid = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    for index, axes in enumerate(grid):
        if index < len(shown):
            _parameter(axes, known, index)
        else:
            axes.set_axis_off()
    for axes in grid[max(0, len(shown) - 2) : len(shown)]:
        axes.xaxis.set_tick_params(labelbottom=True)
        _time_axis(axes, traces)
    return figure


def _parameter(axes: Axes, known: ParameterTraces, index: int) -> None:
    values, band = known.values[:, index], 2 * known.standard_deviations[:, index]
    later = slice(len(values) // 4, None)  # the first values may be far off, their bands as wide as the prior
    limit_y(axes, (values - band)[later], (values + band)[later])
    low, high = axes.get_ylim()
    time_s, below = thin(known.time_s, np.clip(values - band, low, high))
    _, above = thin(known.time_s, np.clip(values + band, low, high))
    axes.fill_between(time_s, below, above, color=SKY, alpha=0.45, linewidth=0)
    plot(axes, known.time_s, values, BLUE, known.names[index], width=1.3)
    axes.set_title(known.names[index])


def _lateness(known: Mapping[str, LoopTiming]) -> Figure:
    figure = new_figure(2.7)
    axes = figure.subplots()
    for (role, timing), colour in zip(known.items(), (BLUE, VERMILION), strict=False):
        edges, counts = _histogram(timing)
        label = f"{role}: {timing.loop}"
        axes.stairs(counts, edges, fill=True, color=colour, alpha=0.25)
        axes.stairs(counts, edges, color=colour, linewidth=1.3, label=label)
        axes.loglog()
    axes.set_xlim(right=max(1e3, axes.get_xlim()[1]))
    axes.set_ylim(bottom=0.7)
    for scale in axes.xaxis, axes.yaxis:
        scale.set_major_formatter("{x:g}")
        scale.set_minor_formatter("")
    _finish(axes, "ticks", "lateness in µs")

    return figure


def _drawable(timing: LoopTiming) -> bool:
    edges, counts = timing.edges_us, timing.counts
    ascending = all(0 < low < high for low, high in pairwise(edges))
    return len(counts) == len(edges) + 1 >= 3 and ascending and min(counts) >= 0 and any(counts)


def _histogram(timing: LoopTiming) -> tuple[Floats, Floats]:
    """(edges in us, counts): the outer bins, open in truth, are drawn as wide as their neighbours."""
    upper = np.array(timing.edges_us)
    edges = np.concatenate((upper[:1] ** 2 / upper[1:2], upper, upper[-1:] ** 2 / upper[-2:-1]))
    counts = np.array(timing.counts, dtype=np.float64)
    last = int(np.flatnonzero(counts)[-1]) + 1
    return edges[: last + 1], counts[:last]


def _time_axis(axes: Axes, traces: AxisTraces) -> None:
    """The same for all figures along time, so that they can be compared."""
    axes.set_xlim(0, traces.duration_s or 1.0)
    axes.set_xlabel("time in s")


def _finish(axes: Axes, y: str, x: str = "") -> None:
    axes.set_ylabel(y)
    axes.set_xlabel(x)
    axes.margins(x=0.01)
    axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0, 1), borderpad=0)


_RECIPES: tuple[Recipe, ...] = (
    (_force, "Force", FORCE),
    (_force_detail, f"Force: {_DETAIL_S:g} s from the middle", DETAIL),
    (_error, "Error of prediction and hold", ERROR),
    (_position, "Position", POSITION),
    (_states, "Safety state of the slave", STATES),
    (_delay, "Delay", DELAY),
    (_parameters, "Identified parameters", PARAMETERS),
)
