"""The report of a run as data: what report.json holds."""

import json
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.messages import LoopTiming
from common.recording.mcap_reader import Run
from common.topics import (
    MASTER_STATE,
    MASTER_TIMING,
    PARAMETERS,
    RECORDED,
    SAFETY_EVENT,
    SLAVE_HANDSHAKE,
    SLAVE_STATE,
    SLAVE_TIMING,
    Topic,
)
from forefeel.report.counters import axis_counters, impairment_counters, last
from forefeel.report.score import Comparison, ErrorRatio, ErrorSize, Spread, compare, scored, spread
from forefeel.report.states import armed_share
from forefeel.report.traces import AxisTraces, CommandTraces, axis_traces, run_span_ns

SETTLING_S = 3.0
MOST_EVENTS = 100
_TIMINGS = {"master": MASTER_TIMING, "slave": SLAVE_TIMING}
_HOW = (
    "Scored by command: a prediction, and the hold of the newest force, against the first force that the slave "
    "measured while it executed the command of the same tick.",
    "Both are scored on the same commands, from the first one for which both exist; "
    f"'settled' starts {SETTLING_S:g} s after it.",
)


class _Part(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ScoredCommands(_Part):
    """`sent` by the master; `answered` by a valid force; `scored`: answered, and predicted and held. Shares
    of `sent`.
    """

    sent: int = 0
    answered: int = 0
    scored: int = 0
    answered_share: float | None = None
    scored_share: float | None = None


class LoopFigures(_Part):
    """Lateness of a loop since its start, from its last word; None when it said nothing."""

    p50_us: float | None = None
    p99_us: float | None = None
    max_us: float | None = None
    ticks: int | None = None
    missed: int | None = None
    scheduling: str | None = None


class Loops(_Part):
    """Both ends' 1 kHz loops."""

    master: LoopFigures = LoopFigures()
    slave: LoopFigures = LoopFigures()


class ClockFigures(_Part):
    """The slave's clock minus the master's, true to within +-`bound_s`; as the master knew it last."""

    offset_s: float | None = None
    bound_s: float | None = None
    grade: Literal["good", "acceptable", "poor", "unknown"] = "unknown"


class ParameterFigures(_Part):
    """One identified parameter as it was last; its unit stands in its name."""

    name: str
    value: float
    standard_deviation: float


class ModelFigures(_Part):
    """How far the identification came; None when it said nothing."""

    valid: bool | None = None
    samples: int | None = None
    updates: int | None = None
    resets: int | None = None
    innovation_rms_n: float | None = None


class SafetyNote(_Part):
    """One transition of the slave's safety state."""

    time_s: float
    before: str
    event: str
    after: str
    reason: str


class AxisReport(_Part):
    """One axis. What was not recorded is None, or empty."""

    axis: str | None = None
    commands: ScoredCommands = ScoredCommands()
    prediction: ErrorSize = ErrorSize()
    hold: ErrorSize = ErrorSize()
    ratio: ErrorRatio = ErrorRatio()
    settled: Comparison = Comparison()
    delay_s: Spread = Spread()
    force_age_s: Spread = Spread()
    armed_share: float | None = None
    stops: int | None = None
    clock: ClockFigures = ClockFigures()
    parameters: tuple[ParameterFigures, ...] = ()
    identifiable: tuple[str, ...] = ()
    model: ModelFigures = ModelFigures()
    counters: dict[str, int] = {}
    safety_events: tuple[SafetyNote, ...] = ()
    settings: dict[str, str] = {}
    samples: dict[str, int] = {}
    notes: tuple[str, ...] = ()


class _RunFields(_Part):
    format: Annotated[Literal["forefeel.report/1"], Field(alias="schema")] = "forefeel.report/1"
    recording: str = ""
    cell: str | None = None
    duration_s: float = 0.0
    truncated: bool = False
    seed: str | None = None
    impairment: str | None = None
    loop: Loops = Loops()


class RunReport(AxisReport, _RunFields):
    """The whole run: the fields of its first axis by name, what both daemons say of themselves, every axis in
    `axes`.

    `format` is called `schema` in JSON. `seed` and `impairment` are those of the metadata table `run`.
    `counters`
    counts what the impairment did, too.
    """

    metadata: dict[str, dict[str, str]] = {}
    axes: dict[str, AxisReport] = {}

    def to_json(self) -> str:
        """As JSON text: keys in the order of the fields, None as null, never NaN."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


def summarise(run: Run) -> RunReport:
    """The report of a run; whatever is missing in it, there is a report.

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
        "recording": run.path.name,
        "cell": run.cell,
        "duration_s": (end_ns - start_ns) * 1e-9,
        "truncated": run.truncated,
        "seed": of_run.get("seed"),
        "impairment": of_run.get("impairment"),
        "loop": Loops(**{role: _loop(last_timing(run, role)) for role in _TIMINGS}),
        "counters": first.counters | impairment_counters(run),
        "metadata": metadata,
        "axes": axes,
    }
    return RunReport(**fields)


def last_timing(run: Run, role: str) -> LoopTiming | None:
    """What the master's or the slave's loop said last of its lateness, on whichever axis."""
    topic = _TIMINGS[role]
    return next((timing for axis in run.axes if (timing := last(run.messages(axis, topic)))), None)


def _loop(timing: LoopTiming | None) -> LoopFigures:
    if timing is None:
        return LoopFigures()
    return LoopFigures(**{name: getattr(timing, name) for name in LoopFigures.model_fields})


def _axis_report(run: Run, axis: str, traces: AxisTraces) -> AxisReport:
    commands = _scored_commands(traces.commands)
    slave, master = last(run.messages(axis, SLAVE_STATE)), last(run.messages(axis, MASTER_STATE))
    overall, settled = _compare(traces.commands)
    return AxisReport(
        axis=axis,
        commands=commands,
        prediction=overall.prediction,
        hold=overall.hold,
        ratio=overall.ratio,
        settled=settled,
        delay_s=spread(traces.delay_s),
        force_age_s=spread(traces.force_age_s),
        armed_share=armed_share(traces.states, master.clutched_s if master else 0.0),
        stops=slave.stops if slave else None,
        clock=_clock(run, axis),
        **_model(run, axis),
        counters=axis_counters(run, axis),
        safety_events=_safety_events(run, axis, traces.start_ns),
        settings=_settings(run, axis),
        samples={topic.name: run.count(axis, topic) for topic in RECORDED},
        notes=_notes(run, axis, commands),
    )


def _compare(commands: CommandTraces) -> tuple[Comparison, Comparison]:
    """(all scored commands, those from SETTLING_S after the first of them)."""
    forces = commands.predicted_n, commands.held_n, commands.force_n
    rows = np.flatnonzero(scored(*forces))
    if not len(rows):
        return Comparison(), Comparison()
    late = commands.time_s >= commands.time_s[rows[0]] + SETTLING_S
    return compare(*forces), compare(*(force[late] for force in forces))


def _scored_commands(commands: CommandTraces) -> ScoredCommands:
    sent = len(commands.time_s)
    answered = int(np.count_nonzero(np.isfinite(commands.force_n)))
    both = int(np.count_nonzero(scored(commands.predicted_n, commands.held_n, commands.force_n)))
    return ScoredCommands(
        sent=sent,
        answered=answered,
        scored=both,
        answered_share=answered / sent if sent else None,
        scored_share=both / sent if sent else None,
    )


def _clock(run: Run, axis: str) -> ClockFigures:
    compared = (state for state in run.messages(axis, MASTER_STATE) if state.clock_offset_ns is not None)
    state = last(compared)
    if state is None or state.clock_offset_ns is None or state.clock_bound_ns is None:
        return ClockFigures()
    bound_s = state.clock_bound_ns * 1e-9
    grade: Literal["good", "acceptable", "poor"] = "poor"
    if bound_s <= 0.010:
        grade = "good" if bound_s < 0.001 else "acceptable"
    return ClockFigures(offset_s=state.clock_offset_ns * 1e-9, bound_s=bound_s, grade=grade)


def _model(run: Run, axis: str) -> dict[str, Any]:
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
        "model": ModelFigures(**{name: getattr(message, name) for name in ModelFigures.model_fields}),
    }


def _safety_events(run: Run, axis: str, start_ns: int) -> tuple[SafetyNote, ...]:
    """The first MOST_EVENTS; the counters count all."""
    stamps = run.log_ns(axis, SAFETY_EVENT)[:MOST_EVENTS].tolist()
    return tuple(
        SafetyNote(
            time_s=(stamp_ns - start_ns) * 1e-9,
            before=event.before,
            event=event.event,
            after=event.after,
            reason=event.reason,
        )
        for stamp_ns, event in zip(stamps, run.messages(axis, SAFETY_EVENT), strict=False)
    )


def _settings(run: Run, axis: str) -> dict[str, str]:
    """What both ends had to agree on, as the slave's last handshake says; it came from the network and may be
    anything.
    """
    handshake = last(run.messages(axis, SLAVE_HANDSHAKE))
    if handshake is None or not handshake.settings:
        return {}
    try:
        settings = json.loads(handshake.settings)
    except (ValueError, RecursionError):
        settings = None
    if not isinstance(settings, Mapping):
        return {"settings": handshake.settings}
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in sorted(settings.items())}


def _notes(run: Run, axis: str, commands: ScoredCommands) -> tuple[str, ...]:
    """How it was scored, or why it was not; and what else the reader must know."""
    notes = list(_HOW) if commands.scored else []
    for role in "master", "slave":
        topics: list[Topic[Any]] = [t for t in RECORDED if t.publisher == role]
        if not any(run.count(axis, topic) for topic in topics):
            notes.append(f"No message of the {role} was recorded.")
    if not commands.answered:
        notes.append("No command was answered by a valid force: nothing could be scored.")
    elif not commands.scored:
        notes.append("No answered command had a prediction and a held force: nothing could be scored.")
    handshake = last(run.messages(axis, SLAVE_HANDSHAKE))
    if handshake is not None and not handshake.accepted:
        notes.append(f"The slave refused the session: {handshake.reason}")
    if run.truncated:
        notes.append("The recorder was killed: the run ends where its last whole chunk does.")
    return tuple(notes)
