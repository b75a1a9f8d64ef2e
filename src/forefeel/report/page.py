"""report.json and report.html of a run: its sentence, its figures, and the ten lines for the terminal."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from forefeel.common.error_size import ErrorSize, Floats
from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity
from forefeel.common.limiter import MOTION_RULES
from forefeel.common.messages import Grip, SafetyState
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import SHAPE, SLAVE_STATE
from forefeel.diagnosis.verdict import LEAST_S
from forefeel.files import folder_named_after, fresh_folder, write_all
from forefeel.interrupt import ends_in_order
from forefeel.report.drawing import (
    DASHED,
    DOTTED,
    GAP_S,
    Figure,
    Layer,
    band,
    limits,
    line,
    panel,
    spec,
)
from forefeel.report.model import AxisReport, Loops, RunReport, ScoredCommands
from forefeel.report.score import scored
from forefeel.report.summary import SETTLING_S, last, summarise
from forefeel.report.template import render
from forefeel.report.traces import AxisTraces, ParameterTraces, axis_traces, sent_ns
from forefeel.report.transparency import JND_FLOOR_N, JND_SHARE, Transparency
from forefeel.report.vessel import friction, of_recording
from forefeel.report.wording import (
    DISCLAIMER,
    error_text,
    felt_text,
    in_order,
    micros,
    named,
    number,
    offset_text,
    ratio,
    scale,
    share,
)
from forefeel.terminal import answer, suggest

FILES = ("report.json", "report.html")
_TRIM = 0.002  # share of the highest and of the lowest values of a trace that may lie outside of its picture

_MOST_EVENTS = 100  # in the table
_MOST_PARAMETERS = 24  # that are drawn
_LONGEST = 99  # characters of a line in the terminal
_REASONS = {
    "skipped": "overtaken or lost",
    "not_followed": "at rest",
    "not_predicted": "not predicted",
    "invalid_force": "without a valid force",
}
"""Why a command was not scored, see `ScoredCommands`."""
_RULES = {"sequence": "overtaken by a newer one", "late": "too old"}
"""Of the slave's gate, for which commands are refused over any link that reorders and delays them."""
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
    report, pages = make_pages(Run(run_path))
    write_all(out_dir, pages, [])
    return report


def run_report(recording: Path, out: Path | None, overwrite: bool) -> None:
    """Writes report.json and report.html of a recording into `out`, by default a folder named after it,
    prints the ten lines, and suggests the next command. `overwrite`: an earlier report there is replaced,
    else it is refused.

    Raises:
        InputError: the recording or the folder can not be used; nothing was written.
        RunError: interrupted, or the report can not be written.
    """
    out = out or folder_named_after(recording)
    with ends_in_order("report", out) as written:
        run = Run(recording)
        report, pages = make_pages(run)
        fresh_folder(out, FILES, "an earlier report", overwrite)
        write_all(out, pages, written)
    answer(*ten_lines(report, out), document=report.to_json)
    axis = report.axis if run.axes[1:] else None
    if report.duration_s >= LEAST_S:  # a flight record is shorter
        suggest("diagnose", recording, axis=axis, out=out / "diagnosis", overwrite=overwrite)


def make_pages(run: Run) -> tuple[RunReport, Mapping[str, str]]:
    """Makes the report of a run, and the texts of `FILES` by their names; writes nothing.

    Raises:
        RecordingError: a message in the run is not what its topic carries.
    """
    report = summarise(run)
    texts = report.to_json(), render_page(report, run)
    return report, dict(zip(FILES, texts, strict=True))


def render_page(report: RunReport, run: Run) -> str:
    """HTML of the report: its texts, and of each axis figures of vessel, force and parameters."""
    traces = {axis: axis_traces(run, axis) for axis in run.axes}
    return render(
        "report/page.html.j2",
        report=report,
        stills={axis: still(run, axis, of) for axis, of in traces.items()},
        pictures={axis: picture(of) for axis, of in traces.items()},
        parameters={axis: parameters(of) for axis, of in traces.items()},
        most_events=_MOST_EVENTS,
        story=story,
        settling_s=SETTLING_S,
        not_scored=not_scored,
        refused=refused,
        injected=injected,
    )


def still(run: Run, axis: str, traces: AxisTraces) -> Figure | None:
    """Figure of the vessel when the late force was furthest from the measured one of the same command. None
    where the recording names no vessel of this axis, the gripper was opened in the run, no command was
    scored, or no delay or no age of a force is known.
    """
    vessel, of, known = of_recording(run.metadata), traces.commands, traces.parameters
    rows = np.flatnonzero(scored(of.predicted_n, of.zoh_n, of.force_n))
    # what was gripped anew is inserted by another length
    regripped = any(state.gripper is Grip.OPEN for state in run.messages(axis, SLAVE_STATE))
    late = len(traces.delay_s) and np.isfinite(traces.force_age_s).any()
    if vessel is None or vessel.axis != axis or regripped or not len(rows) or not late:
        return None
    row = rows[np.argmax(np.abs(of.zoh_n - of.force_n)[rows])]
    reported_s = of.time_s[row] - np.nanmedian(traces.force_age_s)
    tip_m = np.interp(reported_s, traces.readback_time_s, traces.readback_m)
    shape_mm = _shape_mm(run, axis, traces.start_ns + 1e9 * reported_s) if vessel.walls_mm else None
    most_mn, felt_mn = (1e3 * np.nanmax(np.abs(force_n)) for force_n in (of.zoh_n, of.rendered_n))
    spec = {
        "vessel": vessel.model_dump(mode="json"),
        "shape_mm": shape_mm,
        "reach_mm": [1e3 * end(of.position_m) + vessel.tip_mm for end in (np.nanmin, np.nanmax)],
        "tip_mm": 1e3 * tip_m + vessel.tip_mm,
        "commanded_mm": 1e3 * of.position_m[row] + vessel.tip_mm,
        "predicted_mn": 1e3 * of.predicted_n[row],
        "felt_mn": 1e3 * of.rendered_n[row],
        "measured_mn": 1e3 * of.zoh_n[row],
        "late_ms": round(1e3 * np.median(traces.delay_s)),
        "most_mn": most_mn,
        "most_felt_mn": felt_mn,
        **(friction(known.names, known.values[-1], known.standard_deviations[-1]) if known else {}),
    }
    caption = (
        f"At {of.time_s[row]:.1f} s, when the late force was furthest from the measured one of the same "
        "command. Dashed: where the hand had the tip by then. Friction: as known at the end of the run."
    )
    return Figure("In the vessel", caption, 236 if shape_mm else 168, (spec,))


def _shape_mm(run: Run, axis: str, at_ns: float) -> list[tuple[float, float]] | None:
    """Centre line of the instrument as published last by then; None where there was none."""
    shapes = zip(sent_ns(run, axis, SHAPE).tolist(), run.messages(axis, SHAPE), strict=True)
    shape = last(shape for sent, shape in shapes if sent <= at_ns)
    return None if shape is None else [(1e3 * x, 1e3 * y) for x, y in zip(shape.x_m, shape.y_m, strict=False)]


def picture(traces: AxisTraces) -> Figure | None:
    """Figure of force, felt force, position and safety state along time, a panel for each that was recorded;
    None where there is none of them.
    """
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
        panels.append(panel("force at the catheter, N", near, weight=5, steps=7, lines=lines, bands=bands))
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
    return Figure("Force", caption, 560, (_along_time(traces, panels),)) if panels else None


def _trace(name: str, colour: str, time_s: Floats, values: Floats, **more: object) -> Layer:
    return line(name, colour, time_s, values, GAP_S, **more)


def _along_time(traces: AxisTraces, panels: list[Layer]) -> Layer:
    """Panels on the whole time of the recording, so that figures can be compared."""
    return spec(panels, (0.0, traces.duration_s or 1.0), unit="s")


def _spans(traces: AxisTraces) -> list[Layer]:
    """Spans of the slave's safety state for chart.js, in s since the start; `silent` where unknown."""
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


def parameters(traces: AxisTraces) -> Figure | None:
    """Figure of the identified parameters along time, a canvas for each of 24 at most; None without any."""
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
    """Canvas of the parameter at `index` along time, in a prefixed unit, with a band of two standard
    deviations; the limits of y hold all but the first quarter.
    """
    label, plain = named(known.names[index])
    known_s, later = known.time_s, slice(len(known.time_s) // 4, None)
    factor, unit = scale(plain, float(np.abs(known.values[later, index]).max()))
    values, twice = factor * known.values[:, index], 2 * factor * known.standard_deviations[:, index]
    last = float(f"{values[-1]:.3g}")
    one = panel(
        label,
        limits((values - twice)[later], (values + twice)[later]),
        lines=[_trace("", "predicted", known_s, values, unit=unit or "ratio", now=last)],
        bands=[band("", "predicted", known_s, values - twice, values + twice, GAP_S)],
    )
    return _along_time(traces, [one])


def story(part: AxisReport) -> tuple[str, list[str]]:
    """(headline, sentences of detail) on the error of the felt force beside that of the late one; on the
    predicted force where no felt one could be scored. Where no force was judged the headline says so, and
    there are no sentences.
    """
    twin, measured = part.transparency, part.transparency_as_measured
    felt = twin or measured
    if felt is None and not part.commands.scored:
        return "Nothing was judged: there is no force to compare with.", []
    ahead = "Now" if part.delay_s.p50 is None else f"{1e3 * part.delay_s.p50:.0f} ms ahead"
    model = (
        f"The force at the catheter was predicted with {_in_place(part.prediction, part.zoh)}; after "
        f"{SETTLING_S:g} s of learning {_in_place(part.settled.prediction, part.settled.zoh)}. The 95 % band "
        f"held {share(part.predictor.coverage_95)} of the forces."
    )
    if felt is None:
        return f"{ahead}, the force was predicted with {_in_place(part.prediction, part.zoh)}.", [model]
    beside = [
        *([_felt("that of a twin of the simulated world without noise and delay", twin)] if twin else []),
        *([_felt("the one measured at its command", measured)] if measured else []),
    ]
    return f"{ahead}, the hand felt the force with {_in_place(felt.felt, felt.held)}.", [
        *beside,
        f"No hand tells less than {JND_SHARE * 100:g} %, or {quantity(JND_FLOOR_N, 'N')}; late is the shift "
        "at which the forces correlate best.",
        model,
    ]


def _felt(reference: str, score: Transparency) -> str:
    return (
        f"{share(score.within_jnd)} of the time no hand could tell the felt force from {reference}: it had "
        f"{_in_place(score.felt, score.held)}, and was {offset_text(score.offset_s)} in place of "
        f"{offset_text(score.held_offset_s)}."
    )


def _in_place(size: ErrorSize, late: ErrorSize) -> str:
    return f"{quantity(size.rms_n, 'N')} of error in place of {quantity(late.rms_n, 'N')}"


def not_scored(commands: ScoredCommands) -> str:
    """Reasons why commands were not scored with their numbers, the most frequent first."""
    return in_order({words: commands.reasons.get(name, 0) for name, words in _REASONS.items()})


def refused(counters: Mapping[str, int]) -> str:
    """Number of commands that the slave's gate refused, in all and by rule."""
    start = "slave_refused_"
    rules = {name.removeprefix(start): n for name, n in counters.items() if name.startswith(start)}
    by_rule = in_order({_RULES.get(name, name): n for name, n in rules.items()})
    return f"{sum(rules.values())} refused{f' ({by_rule})' if by_rule else ''}"


def injected(counters: Mapping[str, int]) -> str:
    """Text on the messages that the injected impairment dropped, duplicated or delayed, begun by a semicolon;
    empty where there are none.
    """

    def total(what: str) -> int:
        return sum(
            n for name, n in counters.items() if name.startswith("impairment_") and name.endswith(what)
        )

    done = in_order({what: total(what) for what in ("dropped", "duplicated", "delayed")})
    return f"; on purpose {done}" if done else ""


def ten_lines(report: RunReport, directory: Path | None = None) -> list[str]:
    """Summary of a run in ten lines of fewer than 100 characters each; longer ones are cut, unprintable
    characters replaced. `directory`: where the files were written.
    """
    where = f" in {directory}" if directory else ""
    ended = ", cut short" if report.truncated else ""
    limited = sum(report.counters.get(f"limit_{rule}", 0) for rule in MOTION_RULES)
    lines = [
        f"Run        {report.recording}: {report.duration_s:.1f} s{ended}, axis {report.axis or 'none'}, "
        f"impairment {report.impairment or 'unknown'}, seed {report.seed or 'unknown'}",
        f"Felt       {felt_text(report)}",
        f"Prediction {_prediction_text(report)}",
        f"Scored     {report.commands.scored} of {report.commands.sent} commands; "
        f"{not_scored(report.commands) or 'all'}",
        f"Delay      {quantity(report.delay_s.p50, 's')} p50, {quantity(report.delay_s.p99, 's')} p99, "
        f"{quantity(report.delay_s.max, 's')} max, of a round trip; newest force "
        f"{quantity(report.force_age_s.p50, 's')} old",
        f"Armed      {share(report.armed_share)} of the session; {number(report.stops)} stops nobody chose",
        f"Loops      {_loops_text(report.loop)}",
        f"Counters   {limited} motions limited; {refused(report.counters)}{injected(report.counters)}",
        f"Files      report.html, report.json{where}",
        DISCLAIMER,
    ]
    printed = map(printable, lines)  # names in a recording may hold anything
    return [line if len(line) <= _LONGEST else f"{line[: _LONGEST - 3]}..." for line in printed]


def _prediction_text(report: RunReport) -> str:
    if not report.commands.scored:
        return "not judged: no command has a prediction and an answer"
    settled = f"after {SETTLING_S:g} s of learning {ratio(report.settled.ratio)}"
    return f"{error_text(report.prediction, report.zoh, report.ratio)}; {settled}"


def _loops_text(loops: Loops) -> str:
    """Text on lateness (p50, p99) and missed ticks of both loops; where neither was ever late, that time is
    virtual.
    """
    if loops.master.max_us == 0.0 == loops.slave.max_us:
        return "in virtual time: no lateness"
    of = {"master": loops.master, "slave": loops.slave}
    return "p50/p99 late: " + "; ".join(
        f"{role} {micros(loop.p50_us)}/{micros(loop.p99_us)}, {number(loop.missed)} missed"
        for role, loop in of.items()
    )
