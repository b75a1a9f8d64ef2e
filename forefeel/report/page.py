"""report.json and report.html of a run: its sentence, its figures, and the ten lines for the terminal."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from forefeel.common.error_size import ErrorSize, Floats
from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity
from forefeel.common.limiter import MOTION_RULES
from forefeel.common.messages import LoopTiming, SafetyState
from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.files import write_all
from forefeel.report.drawing import (
    DASHED,
    DOTTED,
    GAP_S,
    Figure,
    Layer,
    band,
    bars,
    limits,
    line,
    panel,
    spec,
)
from forefeel.report.model import CalibrationFigures, LoopFigures, NotJudged, RunReport
from forefeel.report.score import scored
from forefeel.report.states import START_S
from forefeel.report.summary import last_timing, summarise
from forefeel.report.template import render
from forefeel.report.traces import AxisTraces, ParameterTraces, axis_traces
from forefeel.report.transparency import Transparency
from forefeel.report.wording import DISCLAIMER, in_order, micros, named, number, ratio, scale, share

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

_MOST_PARAMETERS = 24  # that are drawn
_LONGEST = 99  # characters of a line in the terminal
_STATE_COLOURS: dict[SafetyState | None, str] = {
    SafetyState.IDLE: "line",
    SafetyState.READY: "busy",
    SafetyState.ENGAGING: "warn",
    SafetyState.ARMED: "good",
    SafetyState.STOPPING: "warn",
    SafetyState.FAULT: "bad",
    SafetyState.ESTOPPED: "bad",
    None: "card",
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
    traces = {axis: axis_traces(run, axis) for axis in run.axes}
    return render(
        "report/page.html.j2",
        report=report,
        pictures={axis: picture(of) for axis, of in traces.items()},
        figures={axis: axis_figures(of) for axis, of in traces.items()},
        loops=lateness({role: last_timing(run, role) for role in ("master", "slave")}),
        verdict=verdict,
        calibration=calibration,
        reasons=reasons,
        refused=refused,
        injected=injected,
    )


def picture(traces: AxisTraces) -> Figure | None:
    """Force, felt force, position and safety state along time; None where there is none of them."""
    of, panels = traces.commands, []
    if len(of.time_s):
        near = limits(of.zoh_n, of.force_n, beside=of.predicted_n, trim=_TRIM)
        gap = np.minimum(of.zoh_n, of.predicted_n), np.maximum(of.zoh_n, of.predicted_n)
        lines = [
            _trace("late, without forefeel", "late", of.time_s, of.zoh_n, **DASHED, width=1.8, alpha=0.8),
            _trace("predicted", "predicted", of.time_s, of.predicted_n),
            _trace("measured", "measured", of.time_s, of.force_n, **DOTTED),
        ]
        bands = [
            band("", "late", of.time_s, *gap, GAP_S, alpha=0.13),
            band("95 % band", "predicted", of.time_s, of.low_n, of.high_n, GAP_S),
        ]
        felt = [_trace("felt by the hand", "felt", of.time_s, of.rendered_n)]
        panels.append(panel("force at the catheter, N", near, weight=5, lines=lines, bands=bands))
        panels.append(panel("force, N", limits(of.rendered_n, trim=_TRIM), weight=1.5, lines=felt))
    if len(of.time_s) or len(traces.readback_time_s):
        lines = [
            _trace("commanded", "predicted", of.time_s, 1e3 * of.position_m),
            _trace("read back", "readback", traces.readback_time_s, 1e3 * traces.readback_m, **DASHED),
        ]
        panels.append(panel("position, mm", weight=2, lines=lines))
    if traces.states:
        panels.append(panel("safety state of the slave", weight=0.4, hidesY=True, spans=_spans(traces)))
    caption = (
        "Late: the newest force that had arrived, all that the hand could feel without forefeel; the shade "
        "is what forefeel takes away. Predicted: when its command was sent. Measured: while the slave "
        "executed that command, drawn when it was sent. Positions stand where they were sent."
    )
    return _along_time(traces, "Force", caption, 560, panels) if panels else None


def _trace(name: str, colour: str, time_s: Floats, values: Floats, **more: object) -> Layer:
    return line(name, colour, time_s, values, GAP_S, **more)


def _along_time(traces: AxisTraces, title: str, caption: str, height_px: int, panels: list[Layer]) -> Figure:
    """On the whole time of the recording, as all others, so that they can be compared."""
    return Figure(title, caption, height_px, (spec(panels, (0.0, traces.duration_s or 1.0), unit="s"),))


def _spans(traces: AxisTraces) -> list[Layer]:
    return [
        {
            "name": of.state or "silent",
            "colour": _STATE_COLOURS[of.state],
            "alpha": 0.35,
            "from": round((of.start_ns - traces.start_ns) * 1e-9, 3),
            "to": round((of.end_ns - traces.start_ns) * 1e-9, 3),
        }
        for of in traces.states
    ]


def axis_figures(traces: AxisTraces) -> list[Figure]:
    """Errors, delay, parameters; for what was not recorded there is none."""
    made = errors(traces), delay(traces), parameters(traces)
    return [figure for figure in made if figure]


def errors(traces: AxisTraces) -> Figure | None:
    of = traces.commands
    rows = scored(of.predicted_n, of.zoh_n, of.force_n)
    if not rows.any():
        return None
    late_mn, predicted_mn = (1e3 * (force_n - of.force_n)[rows] for force_n in (of.zoh_n, of.predicted_n))
    lines = [
        _trace("late", "late", of.time_s[rows], late_mn, width=1.4, alpha=0.8),
        _trace("predicted", "predicted", of.time_s[rows], predicted_mn, width=1.4),
    ]
    near = limits(late_mn, beside=predicted_mn, trim=_TRIM)
    return _along_time(
        traces,
        "Error of the predicted and of the late force",
        "Against the measured force of the same command. What is far off may lie outside of the picture; the "
        "numbers count it.",
        260,
        [panel("error, mN", near, lines=lines)],
    )


def delay(traces: AxisTraces) -> Figure | None:
    if not len(traces.delay_s):
        return None
    delay_ms = 1e3 * traces.delay_s
    span = float(np.ptp(delay_ms)) or 1.0
    counts, edges = np.histogram(delay_ms, 60, (delay_ms.min() - 0.02 * span, delay_ms.max() + 0.02 * span))
    rules = []
    for part, dash in (0.50, {}), (0.99, DASHED):
        value_ms = float(np.quantile(delay_ms, part))
        name = f"{part:.0%} within {value_ms:.4g} ms"
        rules.append({"name": name, "colour": "ink", "at": round(value_ms, 3), "width": 1.2, **dash})
    upright = panel("commands", bars=[bars("", "predicted", edges, counts)], rules=rules)
    caption = "From a command to the arrival of its force, on the master's clock; once for each command."
    return Figure("Delay", caption, 220, (spec([upright], unit="ms"),))


def parameters(traces: AxisTraces) -> Figure | None:
    known = traces.parameters
    if known is None:
        return None
    specs = [_parameter(traces, known, index) for index in range(min(len(known.names), _MOST_PARAMETERS))]
    caption = (
        "With bands of two standard deviations, which know of noise and not of errors of the model. What is "
        "far off in the first quarter may lie outside of the picture."
    )
    return Figure("Identified parameters", caption, 150, tuple(specs))


def _parameter(traces: AxisTraces, known: ParameterTraces, index: int) -> Layer:
    label, plain = named(known.names[index])
    known_s, later = known.time_s, slice(len(known.time_s) // 4, None)
    factor, unit = scale(plain, float(np.abs(known.values[later, index]).max()))
    values, twice = factor * known.values[:, index], 2 * factor * known.standard_deviations[:, index]
    one = panel(
        "",
        limits((values - twice)[later], (values + twice)[later]),
        lines=[_trace(f"{label}, {unit}" if unit else label, "predicted", known_s, values)],
        bands=[band("", "predicted", known_s, values - twice, values + twice, GAP_S)],
    )
    return spec([one], (0.0, traces.duration_s or 1.0), unit="s")


def lateness(timings: Mapping[str, LoopTiming | None]) -> list[Figure]:
    """Of the loops, by role; nothing when neither said anything."""
    known = {role: timing for role, timing in timings.items() if timing and _drawable(timing)}
    if not known:
        return []
    layers = [
        bars(f"{role}: {timing.loop}", colour, *_histogram(timing), alpha=0.4)
        for (role, timing), colour in zip(known.items(), ("predicted", "readback"), strict=False)
    ]
    caption = (
        "How late each tick began after its deadline. The first bin holds all that was earlier, the last all "
        "that was later."
    )
    one = spec([panel("ticks", {"log": True}, bars=layers)], log=True, label="lateness, µs")
    return [Figure("Lateness of the 1 kHz loops", caption, 240, (one,))]


def _drawable(timing: LoopTiming) -> bool:
    edges, counts = timing.edges_us, timing.counts
    ascending = all(0 < low < high for low, high in pairwise(edges))
    return len(counts) == len(edges) + 1 >= 3 and ascending and min(counts) >= 0 and any(counts[1:])


def _histogram(timing: LoopTiming) -> tuple[Floats, Floats]:
    """(edges in us, counts): the outer bins, open in truth, are drawn as wide as their neighbours."""
    upper = np.array(timing.edges_us)
    edges = np.concatenate((upper[:1] ** 2 / upper[1:2], upper, upper[-1:] ** 2 / upper[-2:-1]))
    counts = np.array(timing.counts, dtype=np.float64)
    last = int(np.flatnonzero(counts)[-1]) + 1
    return edges[: last + 1], counts[:last]


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
