"""report.json and report.html of a run: its figures, its sentences, and the ten lines for the terminal."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from forefeel.common.error_size import ErrorSize, Floats
from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity
from forefeel.common.limiter import MOTION_RULES
from forefeel.common.messages import LoopTiming, SafetyState
from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.files import write_all
from forefeel.report.drawing import (
    BINS,
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
    band,
    drawn,
    finish,
    limit_y,
    new_figure,
    one_plot,
    plain_numbers,
    plot,
    styled,
)
from forefeel.report.model import CalibrationFigures, LoopFigures, NotJudged, RunReport
from forefeel.report.score import scored
from forefeel.report.states import START_S
from forefeel.report.summary import last_timing, summarise
from forefeel.report.template import render
from forefeel.report.traces import AxisTraces, CommandTraces, ParameterTraces, axis_traces
from forefeel.report.transparency import Transparency
from forefeel.report.wording import DISCLAIMER, in_order, micros, named, number, ratio, share

FILES = ("report.json", "report.html")
REASONS = {
    "not_followed": "not followed",
    "skipped": "skipped",
    "invalid_force": "invalid force",
    "not_predicted": "not predicted",
}
"""Why a command was not judged, see `NotJudged`."""

_TRIM = 0.002
"""Share of the highest and of the lowest values of a trace that may lie outside of its picture."""

# parameters that are drawn, in two columns
_MOST_PARAMETERS = 24
_DETAIL_S = 4.0  # of the force that is drawn large
_LONGEST = 99  # characters of a line in the terminal
_STATE_COLOURS: dict[SafetyState | None, str] = {
    SafetyState.IDLE: GREY,
    SafetyState.READY: SKY,
    SafetyState.ENGAGING: YELLOW,
    SafetyState.ARMED: GREEN,
    SafetyState.STOPPING: ORANGE,
    SafetyState.FAULT: VERMILION,
    SafetyState.ESTOPPED: PURPLE,
    None: "#ffffff",
}


def write_report(run_path: Path, out_dir: Path) -> RunReport:
    """Writes report.json and report.html of a recorded run into `out_dir`, each whole or not at all.

    The same recording gives the same bytes.

    Raises:
        RecordingError: the recording can not be read.
        RunError: the files can not be written.
    """
    report, pages = make_pages(read_run(run_path))
    write_all(out_dir, pages, [])
    return report


def make_pages(run: Run) -> tuple[RunReport, Mapping[str, str]]:
    """The report of a run, and the text of each of `FILES`.

    Raises:
        RecordingError: a message in the run is not what its topic carries.
    """
    report = summarise(run)
    texts = report.to_json(), render_page(report, run)
    return report, dict(zip(FILES, texts, strict=True))


def render_page(report: RunReport, run: Run) -> str:
    """The report with figures as one HTML file that needs nothing else."""
    return render(
        "report/page.html.j2",
        report=report,
        drawings={axis: axis_drawings(axis, axis_traces(run, axis)) for axis in run.axes},
        loops=loop_drawings({role: last_timing(run, role) for role in ("master", "slave")}),
        verdict=verdict,
        calibration=calibration,
        reasons=reasons,
        refused=refused,
        injected=injected,
    )


@styled()
def axis_drawings(axis: str, traces: AxisTraces) -> list[Drawing]:
    """The figures of one axis; for what was not recorded there is none."""
    made = [(recipe(traces), title, caption) for recipe, title, caption in _FIGURES]
    return [drawn(figure, axis, title, caption) for figure, title, caption in made if figure]


@styled()
def loop_drawings(timings: Mapping[str, LoopTiming | None]) -> list[Drawing]:
    """Lateness of the loops, by role; nothing when neither said anything."""
    known = {role: timing for role, timing in timings.items() if timing and _drawable(timing)}
    caption = (
        "How late each tick began after its deadline; both axes are logarithmic. The first bin holds all "
        "that was earlier, the last all that was later."
    )
    return [drawn(_lateness(known), "", "Lateness of the 1 kHz loops", caption)] if known else []


def _force(traces: AxisTraces) -> Figure | None:
    commands = traces.commands
    if not len(commands.time_s):
        return None
    figure = new_figure(4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.3, 1))
    _contact_force(above, commands)
    limit_y(below, commands.rendered_n)
    plot(below, commands.time_s, commands.rendered_n, GREEN, "felt by the hand")
    finish(below, "time in s", "force in N")
    _whole_time(below, traces)
    return figure


def _force_detail(traces: AxisTraces) -> Figure | None:
    """A stretch from the middle of what was scored."""
    commands = traces.commands
    times = commands.time_s[scored(commands.predicted_n, commands.zoh_n, commands.force_n)]
    if not len(times) or np.ptp(commands.time_s) < 2 * _DETAIL_S:
        return None
    start_s = float(np.median(times)) - _DETAIL_S / 2
    rows = np.flatnonzero((commands.time_s >= start_s) & (commands.time_s < start_s + _DETAIL_S))
    columns = {name: getattr(commands, name)[rows] for name in CommandTraces.__dataclass_fields__}
    figure, axes = one_plot(3.3)
    _contact_force(axes, CommandTraces(**columns), "time in s")
    return figure


def _contact_force(axes: Axes, commands: CommandTraces, x: str = "") -> None:
    limit_y(axes, commands.zoh_n, commands.force_n, beside=commands.predicted_n, trim=_TRIM)
    band(axes, commands.time_s, commands.low_n, commands.high_n, "95 % band")
    plot(axes, commands.time_s, commands.zoh_n, ORANGE, "zero-order hold (newest that had arrived)")
    plot(axes, commands.time_s, commands.force_n, BLACK, "measured, by command", width=1.7)
    plot(axes, commands.time_s, commands.predicted_n, BLUE, "predicted")
    finish(axes, x, "force in N")


def _error(traces: AxisTraces) -> Figure | None:
    commands = traces.commands
    rows = scored(commands.predicted_n, commands.zoh_n, commands.force_n)
    if not rows.any():
        return None
    zoh_mn = 1e3 * (commands.zoh_n - commands.force_n)[rows]
    predicted_mn = 1e3 * (commands.predicted_n - commands.force_n)[rows]
    figure, axes = one_plot(3.0)
    limit_y(axes, zoh_mn, beside=predicted_mn, trim=_TRIM)
    axes.axhline(0, color="#8a939e", linewidth=0.8)
    plot(axes, commands.time_s[rows], zoh_mn, ORANGE, "zero-order hold - measured")
    plot(axes, commands.time_s[rows], predicted_mn, BLUE, "predicted - measured")
    finish(axes, "time in s", "error in mN")
    _whole_time(axes, traces)
    return figure


def _position(traces: AxisTraces) -> Figure | None:
    commands = traces.commands
    if not len(commands.time_s) and not len(traces.readback_time_s):
        return None
    commanded_mm, readback_mm = 1e3 * commands.position_m, 1e3 * traces.readback_m
    figure, axes = one_plot(2.7)
    limit_y(axes, commanded_mm, readback_mm)
    plot(axes, commands.time_s, commanded_mm, BLUE, "commanded")
    plot(axes, traces.readback_time_s, readback_mm, VERMILION, "read back")
    finish(axes, "time in s", "position in mm")
    _whole_time(axes, traces)
    return figure


def _states(traces: AxisTraces) -> Figure | None:
    if not traces.states:
        return None
    figure, axes = one_plot(1.35)
    for state in dict.fromkeys(span.state for span in traces.states):
        bars = [
            ((span.start_ns - traces.start_ns) * 1e-9, (span.end_ns - span.start_ns) * 1e-9)
            for span in traces.states
            if span.state is state
        ]
        axes.broken_barh(bars, (0, 1), facecolor=_STATE_COLOURS[state], edgecolor="none")
    axes.set_yticks([])
    axes.set_ylim(0, 1)
    axes.grid(False)
    axes.set_xlim(0, traces.duration_s)
    axes.set_xlabel("time in s")
    patches = [
        Patch(facecolor=_STATE_COLOURS[state], edgecolor="#8a939e", linewidth=0.5, label=state or "silent")
        for state in _STATE_COLOURS
        if any(span.state is state for span in traces.states)
    ]
    axes.legend(handles=patches, ncols=len(patches), loc="lower left", bbox_to_anchor=(0, 1))
    return figure


def _delay(traces: AxisTraces) -> Figure | None:
    if not len(traces.delay_s):
        return None
    delay_ms = 1e3 * traces.delay_s
    figure, axes = one_plot(2.5)
    span = float(np.ptp(delay_ms)) or 1.0
    axes.hist(
        delay_ms, bins=60, range=(delay_ms.min() - 0.02 * span, delay_ms.max() + 0.02 * span), color=SKY
    )
    for part, dashes in (0.50, "solid"), (0.99, "dashed"):
        value_ms = float(np.quantile(delay_ms, part))
        label = f"{part:.0%} within {value_ms:.4g} ms"
        axes.axvline(value_ms, color=BLACK, linewidth=1.2, linestyle=dashes, label=label)
    finish(axes, "from a command to the arrival of its force, in ms", "commands")
    return figure


def _parameters(traces: AxisTraces) -> Figure | None:
    known = traces.parameters
    if known is None:
        return None
    shown = known.names[:_MOST_PARAMETERS]
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
        axes.set_xlabel("time in s")
        _whole_time(axes, traces)
    return figure


def _parameter(axes: Axes, known: ParameterTraces, index: int) -> None:
    values, twice = known.values[:, index], 2 * known.standard_deviations[:, index]
    later = slice(len(values) // 4, None)  # the first values may be far off, their bands as wide as the prior
    limit_y(axes, (values - twice)[later], (values + twice)[later])
    band(axes, known.time_s, values - twice, values + twice)
    plot(axes, known.time_s, values, BLUE, known.names[index], width=1.3)
    label, unit = named(known.names[index])
    axes.set_title(f"{label} in {unit}" if unit else label)


def _lateness(known: Mapping[str, LoopTiming]) -> Figure:
    figure, axes = one_plot(2.7)
    for (role, timing), colour in zip(known.items(), (BLUE, VERMILION), strict=False):
        edges, counts = _histogram(timing)
        label = f"{role}: {timing.loop}"
        axes.stairs(counts, edges, fill=True, color=colour, alpha=0.25)
        axes.stairs(counts, edges, color=colour, linewidth=1.3, label=label)
        axes.loglog()
    axes.set_xlim(right=max(1e3, axes.get_xlim()[1]))
    axes.set_ylim(bottom=0.7)
    plain_numbers(axes.xaxis, axes.yaxis)
    finish(axes, "lateness in µs", "ticks")
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


def _whole_time(axes: Axes, traces: AxisTraces) -> None:
    """The same for all figures along time, so that they can be compared."""
    axes.set_xlim(0, traces.duration_s or 1.0)


_THINNED = f"Long traces are drawn as the smallest and largest value in each of {BINS} stretches of time."
_FIGURES: tuple[tuple[Callable[[AxisTraces], Figure | None], str, str], ...] = (
    (
        _force,
        "Force",
        "Above: prediction and zero-order hold when a command was sent, and the force measured when the "
        "slave executed it, drawn at the time of the command. Below: what the hand felt, which is the "
        "prediction scaled to the hand, limited, kept passive, and faded out while the slave does not "
        f"follow. The band should hold 95 % of the measured forces. {_THINNED}",
    ),
    (
        _force_detail,
        f"Force: {_DETAIL_S:g} s from the middle",
        "The same, from the middle of what was scored. The zero-order hold is a force of the past; the "
        "prediction should lie on the measured force.",
    ),
    (
        _error,
        "Error of prediction and zero-order hold",
        f"Against the measured force, on the same commands. The highest and lowest {_TRIM:.1%}, and a "
        "prediction that is far off, may lie outside of the picture; the figures in numbers count them. "
        f"{_THINNED}",
    ),
    (
        _position,
        "Position",
        f"Each drawn when it was sent; not by command, as the forces are. {_THINNED}",
    ),
    (
        _states,
        "Safety state of the slave",
        "From the slave's own messages, 50 a second. Silent: nothing was heard of it for longer than such a "
        "message counts.",
    ),
    (
        _delay,
        "Delay",
        "From a command to the arrival of the force that answers it, on the master's clock; once for each "
        "command that was answered.",
    ),
    (
        _parameters,
        "Identified parameters",
        "With bands of two standard deviations, which know of noise and not of errors of the model. What is "
        "far off in the first quarter may lie outside of the picture. "
        f"At most {_MOST_PARAMETERS} are drawn. {_THINNED}",
    ),
)


def reasons(found: NotJudged) -> str:
    """Why commands were not judged, the most frequent reason first."""
    return in_order({words: getattr(found, name) for name, words in REASONS.items()})


def refused(counters: Mapping[str, int]) -> str:
    """How many commands the slave's gate refused, and by which rules."""
    start = "slave_refused_"
    rules = {name.removeprefix(start): n for name, n in counters.items() if name.startswith(start)}
    by_rule = in_order(rules)
    return f"{sum(rules.values())} refused{f' ({by_rule})' if by_rule else ''}"


def injected(counters: Mapping[str, int]) -> str:
    """What the injected impairment did to messages of both ends."""

    def total(what: str) -> int:
        return sum(
            n for name, n in counters.items() if name.startswith("impairment_") and name.endswith(what)
        )

    return ", ".join(f"{total(what)} {what}" for what in ("dropped", "duplicated", "delayed"))


def calibration(found: CalibrationFigures) -> str:
    who = f"{found.driver} {found.slot.replace('_', ' ')}, serial {found.serial}, calibrated {found.date}"
    if found.slot == "stage":
        scale = f"{number(found.native_per_m)} native units per m, zero at {number(found.zero)}"
        return f"{who}: {scale}, home found again within {quantity(found.repeatability_m, 'm')}"
    scale = f"{quantity(found.gain_n, 'N')} per native unit, zero at {number(found.zero)}"
    left = f"residual {quantity(found.residual_n, 'N')}, hysteresis {quantity(found.hysteresis_n, 'N')}"
    return f"{who}: {scale}, {left}"


def verdict(ratio_rms: float | None) -> str:
    if ratio_rms is None:
        return "nothing to compare"
    if ratio_rms > 1:
        return "worse than holding the last force"
    return "better than holding the last force" if ratio_rms < 1 else "as good as holding the last force"


def _felt(found: Transparency | None) -> str:
    if found is None:
        return "not scored: no simulated world was followed"
    return (
        f"{ratio(found.ratio)} of the held error; {quantity(found.felt.rms_n, 'N')} rms at the hand, "
        f"{ratio(found.jnd_rms)} JND; {share(found.within_jnd)} within 1 JND"
    )


def ten_lines(report: RunReport, directory: Path | None = None) -> list[str]:
    """Ten lines of fewer than 100 characters each. `directory`: where the files were written."""
    where = f" in {directory}" if directory else ""
    lines = [
        f"Run        {_what_ran(report)}",
        f"Felt       {_felt(report.transparency)}",
        f"Prediction {_size(report.prediction)}; {report.commands.scored} of {report.commands.sent} "
        "commands scored",
        f"ZOH        {_size(report.zoh)}; prediction / ZOH {ratio(report.ratio.rms)}, "
        f"settled {ratio(report.settled.ratio.rms)}",
        f"Delay      {quantity(report.delay_s.p50, 's')} p50, {quantity(report.delay_s.p99, 's')} p99, "
        f"{quantity(report.delay_s.max, 's')} max; force age {quantity(report.force_age_s.p50, 's')}; "
        f"clocks {_clock(report)}",
        f"Armed      {share(report.armed_share)} from the first arming (or {START_S:g} s) "
        f"to the session's end; {_count(report.stops)} unchosen stops",
        f"Loops      p50/p99 late: {_loop('master', report.loop.master)}; "
        f"{_loop('slave', report.loop.slave)}",
        f"Counters   {_counters(report)}",
        f"Files      report.html, report.json{where}",
        DISCLAIMER,
    ]
    return [_fitted(line) for line in lines]


def _what_ran(report: RunReport) -> str:
    ended = ", cut short" if report.truncated else ""
    return (
        f"{report.recording}: {report.duration_s:.1f} s{ended}, axis {report.axis or 'none'}, "
        f"impairment {report.impairment or 'unknown'}, seed {report.seed or 'unknown'}"
    )


def _size(size: ErrorSize) -> str:
    return (
        f"{quantity(size.rms_n, 'N')} rms, {quantity(size.p95_n, 'N')} p95, {quantity(size.max_n, 'N')} max"
    )


def _loop(role: str, loop: LoopFigures) -> str:
    return f"{role} {micros(loop.p50_us)}/{micros(loop.p99_us)}, {_count(loop.missed)} missed"


def _clock(report: RunReport) -> str:
    clock = report.clock
    return "unknown" if clock.bound_s is None else f"±{quantity(clock.bound_s, 's')} ({clock.grade})"


def _counters(report: RunReport) -> str:
    limited = sum(report.counters.get(f"limit_{rule}", 0) for rule in MOTION_RULES)
    return f"{limited} limited; on purpose {injected(report.counters)}; {refused(report.counters)}"


def _count(value: int | None) -> str:
    return "unknown" if value is None else str(value)


def _fitted(line: str) -> str:
    """One printable line: names in a recording may hold anything."""
    clean = printable(line)
    return clean if len(clean) <= _LONGEST else f"{clean[: _LONGEST - 3]}..."
