"""The report of a run, worked out from its messages."""

from collections import Counter
from collections.abc import Iterable
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np

from forefeel.common.events.console import printable
from forefeel.common.messages import Handshake, LoopTiming, Message
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import (
    CALIBRATION,
    HAPTICS,
    LIMIT_EVENT,
    MASTER_IMPAIRMENT,
    MASTER_LIMIT,
    MASTER_STATE,
    MASTER_TIMING,
    PARAMETERS,
    RECORDED,
    SAFETY_EVENT,
    SLAVE_HANDSHAKE,
    SLAVE_IMPAIRMENT,
    SLAVE_STATE,
    SLAVE_TIMING,
    Topic,
)
from forefeel.report.model import (
    AxisReport,
    LoopFigures,
    Loops,
    ModelFigures,
    ParameterFigures,
    PredictorFigures,
    RunReport,
    SafetyNote,
    ScoredCommands,
)
from forefeel.report.score import PredictionComparison, compare, scored, spread
from forefeel.report.states import armed_share
from forefeel.report.traces import AxisTraces, CommandTraces, axis_traces, run_span_ns, sent_ns
from forefeel.report.transparency import against_twin, as_measured
from forefeel.report.wording import fault_texts, share

SETTLING_S = 3.0
"""From the first scored command to the first one that counts as settled."""
_SILENT_S = 1.0  # A master that is silent for so long has missed ten of its states
_LIMITED_SHARE = 0.05  # a simulated vessel comes to 0.2 %
_HAND_LIMITS = {
    "rendered_force": "cut off: rendering.max_force_n = {applied:.3g} would have to be {requested:.3g}, or "
    "rendering.force_scale less",
    "rendered_step": "smoothed: rendering.max_slew_n_s would have to be higher",
    "rendered_energy": "kept passive: the hand had not put in the energy that it would have been given, as "
    "by a constant push or an offset of the load cell; no setting allows that",
}
M = TypeVar("M", bound=Message)
_IMPAIRMENTS = (("master", MASTER_IMPAIRMENT), ("slave", SLAVE_IMPAIRMENT))
_OF_EVENT = {"before", "event", "after", "reason"}
_HEADER = {"protocol", "session_id", "sequence", "stamp_ns"}  # of every message


def summarise(run: Run) -> RunReport:
    """Works out the report of a run: its own fields, those of its first axis, and every axis in `axes`. What
    was not recorded is None or empty, and mostly noted.

    Raises:
        RecordingError: a message in the run is not what its topic carries.
    """
    axes = {axis: _axis_report(run, axis, axis_traces(run, axis)) for axis in run.axes}
    first = next(iter(axes.values()), AxisReport(notes=("Nothing was recorded.",)))
    start_ns, end_ns = run_span_ns(run)
    metadata = {name: dict(sorted(table.items())) for name, table in sorted(run.metadata.items())}
    of_run = metadata.get("run", {})
    fields: dict[str, Any] = {
        **dict(first),
        "recording": printable(run.path.name),
        "cell": run.cell,
        "duration_s": (end_ns - start_ns) * 1e-9,
        "truncated": run.truncated,
        "seed": of_run.get("seed"),
        "impairment": of_run.get("impairment"),
        "loop": Loops(master=_loop_figures(run, MASTER_TIMING), slave=_loop_figures(run, SLAVE_TIMING)),
        "counters": first.counters | impairment_counters(run) | recorder_counters(run),
        "metadata": metadata,
        "axes": axes,
    }
    return RunReport(**fields)


def _loop_figures(run: Run, topic: Topic[LoopTiming]) -> LoopFigures:
    """Lateness of a loop as published last, on the first axis that has it; empty where none has."""
    timings = (last(run.messages(axis, topic)) for axis in run.axes)
    timing = next(filter(None, timings), None)
    return LoopFigures() if timing is None else LoopFigures.model_validate(timing, from_attributes=True)


def _axis_report(run: Run, axis: str, traces: AxisTraces) -> AxisReport:
    """Report of one axis, worked out from its traces and messages; what was not recorded is None or empty."""
    commands = _scored_commands(traces.commands)
    counters = axis_counters(run, axis)
    clutched_s = _increase(run, axis, MASTER_STATE, "clutched_s", traces.session_end_ns)
    overall, settled = _compare(traces.commands)
    energy_j = traces.commands.energy_j[np.isfinite(traces.commands.energy_j)].tolist()
    handshake = last(run.messages(axis, SLAVE_HANDSHAKE))
    events = _safety_events(run, axis, traces.start_ns)
    limited = _hand_limited(run, axis, commands.sent)
    return AxisReport(
        axis=axis,
        commands=commands,
        transparency=against_twin(run, axis, traces.commands),
        transparency_as_measured=as_measured(run, axis, traces.commands),
        prediction=overall.prediction,
        zoh=overall.zoh,
        ratio=overall.ratio,
        settled=settled,
        predictor=_predictor_figures(run, axis, traces.commands),
        hand_energy_j=energy_j[-1] if energy_j else None,
        hand_lowest_energy_j=min(energy_j, default=None),
        hand_limited=limited,
        delay_s=spread(traces.delay_s),
        force_age_s=spread(traces.force_age_s),
        armed_share=armed_share(traces.states, traces.session_end_ns, clutched_s),
        stops=counters.get("stops"),
        **_model_fields(run, axis),
        counters=counters,
        safety_events=events,
        settings=handshake.settings if handshake else "",
        calibrations=_calibrations(run, axis),
        notes=(
            *fault_texts(events),
            *filter(None, [limited]),
            *_notes(run, axis, commands, handshake),
            *_silent_master(run, axis, traces),
        ),
    )


def _compare(commands: CommandTraces) -> tuple[PredictionComparison, PredictionComparison]:
    """Comparisons over all scored commands, and over those from SETTLING_S after the first; both empty where
    none was scored.
    """
    forces = commands.predicted_n, commands.zoh_n, commands.force_n
    rows = np.flatnonzero(scored(*forces))
    if not len(rows):
        return PredictionComparison(), PredictionComparison()
    late = commands.time_s - commands.time_s[rows[0]] > SETTLING_S - 1e-6  # stamps are rounded to ns
    return compare(*forces), compare(*(force[late] for force in forces))


def _hand_limited(run: Run, axis: str, sent: int) -> str:
    """Sentence on the limit that changed the force at the hand most often, with its setting; empty where that
    was for less than 5 % of the commands.
    """
    counts, most = Counter[str](), {"requested": 0.0, "applied": 0.0}
    for event in run.messages(axis, MASTER_LIMIT):
        if event.rule in _HAND_LIMITS:
            counts[event.rule] += event.count
        if event.rule == "rendered_force":
            most = {name: max(value, abs(getattr(event, name))) for name, value in most.items()}
    rule, count = max(counts.items(), key=itemgetter(1), default=("", 0))
    if not rule or count < _LIMITED_SHARE * sent:
        return ""
    of = share(count / sent) if sent else "all"
    return f"For {of} of the commands the force at the hand was {_HAND_LIMITS[rule].format(**most)} ({rule})."


def _predictor_figures(run: Run, axis: str, commands: CommandTraces) -> PredictorFigures:
    """Coverage and mean width of the band, over the commands with band and force; shares of the leading
    experts, over all haptic samples that name one. All empty where no command has band and force.
    """
    leading = Counter(message.leading for message in run.messages(axis, HAPTICS) if message.leading)
    rows = np.isfinite(commands.low_n) & np.isfinite(commands.high_n) & np.isfinite(commands.force_n)
    if not rows.any():
        return PredictorFigures()
    low_n, high_n, force_n = commands.low_n[rows], commands.high_n[rows], commands.force_n[rows]
    return PredictorFigures(
        coverage_95=float(np.mean((low_n <= force_n) & (force_n <= high_n))),
        band_width_n=float(np.mean(high_n - low_n)),
        leading={name: n / leading.total() for name, n in leading.most_common()},
    )


def _scored_commands(commands: CommandTraces) -> ScoredCommands:
    """Numbers of commands that were sent, answered by a valid force, and scored; of the others by reason, see
    `ScoredCommands`.
    """
    answered, executed, followed = np.isfinite(commands.force_n), commands.executed, commands.followed
    both = scored(commands.predicted_n, commands.zoh_n, commands.force_n)
    reasons = {
        "not_followed": ~followed,
        "skipped": followed & ~executed,
        "invalid_force": executed & ~answered,
        "not_predicted": answered & ~both,
    }
    return ScoredCommands(
        sent=len(commands.time_s),
        answered=int(np.count_nonzero(answered)),
        scored=int(np.count_nonzero(both)),
        reasons={name: int(np.count_nonzero(rows)) for name, rows in reasons.items()},
    )


def _increase(run: Run, axis: str, topic: Topic[Any], name: str, end_ns: float = np.inf) -> float:
    """Increase, in the messages sent until `end_ns`, of a total that counts from the start of its sender: the
    recorder may start later. One that went back began again at 0. 0 without messages.
    """
    at_ns = sent_ns(run, axis, topic)
    rows = np.argsort(at_ns, kind="stable")
    totals = run.column(axis, topic, name)[rows[at_ns[rows] <= end_ns]]
    steps = np.diff(totals)
    return float(np.where(steps < 0, totals[1:], steps).sum())


def _silent_master(run: Run, axis: str, traces: AxisTraces) -> tuple[str, ...]:
    """Note that the master fell silent with the deadman held, killed or cut off, 1 s or more before the end
    of the recording; empty otherwise.
    """
    state = last(run.messages(axis, MASTER_STATE))
    end_s = (traces.session_end_ns - traces.start_ns) * 1e-9
    if state is None or not state.deadman or traces.duration_s - end_s < _SILENT_S:
        return ()
    return (
        f"The master was heard last at {end_s:.1f} s and had not let go of the deadman: it was killed, or "
        "the recorder lost it. The armed time ends there.",
    )


def _model_fields(run: Run, axis: str) -> dict[str, Any]:
    """Fields of AxisReport from the newest parameters; none where nothing was published."""
    message = last(run.messages(axis, PARAMETERS))
    if message is None:
        return {}
    rows = zip(message.names, message.values, message.standard_deviations, strict=False)
    return {
        "parameters": tuple(
            ParameterFigures(name=name, value=value, standard_deviation=deviation)
            for name, value, deviation in rows
        ),
        "identifiable": message.identifiable,
        "model": ModelFigures.model_validate(message, from_attributes=True),
    }


def _safety_events(run: Run, axis: str, start_ns: int) -> tuple[SafetyNote, ...]:
    stamps = sent_ns(run, axis, SAFETY_EVENT).tolist()
    return tuple(
        SafetyNote(time_s=(stamp_ns - start_ns) * 1e-9, **event.model_dump(include=_OF_EVENT))
        for stamp_ns, event in zip(stamps, run.messages(axis, SAFETY_EVENT), strict=True)
    )


def _calibrations(run: Run, axis: str) -> tuple[dict[str, str | float], ...]:
    """Calibrations that drivers of the slave had loaded, each once, in the order of their first message."""
    loaded: list[dict[str, str | float]] = []
    for message in run.messages(axis, CALIBRATION):
        entry = message.model_dump(exclude=_HEADER, exclude_none=True)
        if entry not in loaded:
            loaded.append(entry)
    return tuple(loaded)


def _notes(run: Run, axis: str, commands: ScoredCommands, handshake: Handshake | None) -> tuple[str, ...]:
    """Notes for the reader: a master or slave without messages, caveats, why nothing was judged, a refused
    session, units of a rotation, a recording cut short; empty where there are none.
    """
    notes = []
    for role in "master", "slave":
        topics: list[Topic[Any]] = [t for t in RECORDED if t.publisher == role]
        if not any(run.count(axis, topic) for topic in topics):
            notes.append(f"No message of the {role} was recorded.")
    for state in last(run.messages(axis, SLAVE_STATE)), last(run.messages(axis, MASTER_STATE)):
        notes += [f"With {caveat}." for caveat in (state.caveats if state else ())]
    if not commands.answered:
        notes.append("No command was answered by a valid force: nothing could be judged.")
    elif not commands.scored:
        notes.append("No answered command had a prediction and a received force: nothing could be judged.")
    if handshake is not None and not handshake.accepted:
        notes.append(f"The slave refused the session: {handshake.reason}")
    if handshake is not None and '"kind": "rotation"' in handshake.settings:
        notes.append("A rotation: m are of arc and N tangential, at the surface of the instrument.")
    if run.truncated:
        notes.append("The recorder was killed: the run ends where its last whole chunk does.")
    return tuple(notes)


def last(messages: Iterable[M]) -> M | None:
    newest = None
    for newest in messages:  # noqa: B007 - wanted is what the loop leaves behind
        pass
    return newest


def axis_counters(run: Run, axis: str) -> dict[str, int]:
    """Both ends' counters as published last; of the run its stops, limit events by rule, safety events by
    name; sorted.
    """
    counts: Counter[str] = Counter()
    for event in run.messages(axis, LIMIT_EVENT):
        counts[f"limit_{event.rule}"] += event.count
    for transition in run.messages(axis, SAFETY_EVENT):
        counts[f"safety_{transition.event}"] += 1
    slave = last(run.messages(axis, SLAVE_STATE))
    for role, state in ("slave", slave), ("master", last(run.messages(axis, MASTER_STATE))):
        counts.update({f"{role}_{name}": count for name, count in state.counters.items()} if state else {})
    if slave:
        counts["stops"] = int(_increase(run, axis, SLAVE_STATE, "stops"))
    return dict(sorted(counts.items()))


def recorder_counters(run: Run) -> dict[str, int]:
    """Messages that the recorder has not in its file, by reason, as it noted them."""
    noted = run.metadata.get("recorder", {})
    short = {name: n for name, n in noted.items() if len(n) < 20}  # a longer one may be too long for int()
    return {f"recorder_{name}": int(n) for name, n in sorted(short.items()) if n.isdecimal()}


def impairment_counters(run: Run) -> dict[str, int]:
    """Messages of each impaired link: all, and those dropped, duplicated or delayed on purpose; sorted."""
    counts: Counter[str] = Counter()
    for role, topic in _IMPAIRMENTS:
        for part in (part for axis in run.axes for part in run.messages(axis, topic)):
            name = f"impairment_{role}_{part.link}"
            copies = [len(delays_ns) for delays_ns in part.delays_ns]
            counts[f"{name}_messages"] += len(copies)
            counts[f"{name}_dropped"] += copies.count(0)
            counts[f"{name}_duplicated"] += sum(n > 1 for n in copies)
            counts[f"{name}_delayed"] += sum(any(delays_ns) for delays_ns in part.delays_ns)
    return dict(sorted(counts.items()))
