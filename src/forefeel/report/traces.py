"""The arrays that report and figures need of one axis of a run.

Times are when a message was sent, on the recorder's clock: its stamp and the smallest transit that its topic
had. So neither the network's jitter nor a recorder that waits for its disk moves them.
"""

from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import Floats
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import (
    FORCE,
    HAPTICS,
    MASTER_STATE,
    PARAMETERS,
    RECORDED,
    SAFETY_EVENT,
    SLAVE_STATE,
    Topic,
)
from forefeel.report.score import first_answers, first_of_each, of_one_stretch, stretches
from forefeel.report.states import Span, session_end_ns, spans

Flags = NDArray[np.bool_]

_COLUMNS = "predicted_n", "low_n", "high_n", "zoh_n", "rendered_n", "energy_j"
_JUMP_NS = 10_000_000_000  # messages of one clock may be out of order by less
_HANDLE_FAULT = "handle_fault"  # indication of a master whose handle has failed


@dataclass(frozen=True, slots=True)
class CommandTraces:
    """One row per command, NaN for none. `force_n`: measured while the slave executed that command.

    `executed`: a force answers the command, be it valid or not. `followed`: the slave executed this command,
    or one before it and one after it without a stop between them.
    """

    time_s: Floats
    position_m: Floats
    predicted_n: Floats
    low_n: Floats
    high_n: Floats
    zoh_n: Floats
    rendered_n: Floats
    energy_j: Floats
    force_n: Floats
    executed: Flags
    followed: Flags


@dataclass(frozen=True, slots=True)
class ParameterTraces:
    """Identified parameters of the model used last: names (p), values and deviations (n, p)."""

    names: tuple[str, ...]
    time_s: Floats
    values: Floats
    standard_deviations: Floats


@dataclass(frozen=True, slots=True)
class AxisTraces:
    """One axis. `delay_s`: one round trip per newly answered command. `start_ns`: stamp of t = 0.

    `session_end_ns`: when the last session ended, see `session_end_ns` in `forefeel.report.states`.
    """

    start_ns: int
    duration_s: float
    session_end_ns: int

    commands: CommandTraces
    force_age_s: Floats
    delay_s: Floats
    readback_time_s: Floats
    readback_m: Floats
    states: list[Span]
    parameters: ParameterTraces | None


def run_span_ns(run: Run) -> tuple[int, int]:
    """Receive stamps of the run's first and last message; (0, 0) when it is empty."""
    stamps = [stamps for axis in run.axes for topic in RECORDED if len(stamps := run.log_ns(axis, topic))]
    if not stamps:
        return 0, 0
    return min(int(s.min()) for s in stamps), max(int(s.max()) for s in stamps)


def sent_ns(run: Run, axis: str, topic: Topic[Any]) -> NDArray[np.int64]:
    """Time in ns at which each message of a topic was sent, on the recorder's clock: its stamp and the
    topic's least transit (the second least, for one may be stamped ahead). Empty without messages.

    The time of receipt, if the sender's clock jumped: its host was started again.
    """
    received_ns = run.log_ns(axis, topic)
    if not len(received_ns):
        return received_ns
    stamps_ns = run.column(axis, topic, "stamp_ns")
    transit_ns = received_ns - stamps_ns
    if _jumped(stamps_ns, transit_ns):
        return received_ns
    least_ns = np.partition(transit_ns, min(1, len(transit_ns) - 1))[:2].max()  # one may be stamped ahead
    return np.asarray(stamps_ns + least_ns, dtype=np.int64)


def _jumped(stamps_ns: NDArray[np.int64], transit_ns: NDArray[np.int64]) -> bool:
    """True where the clock went back, or ahead of all that was known of it.

    A recorder that falls behind, however far, does neither: it only makes a transit longer.
    """
    back = np.diff(stamps_ns) < -_JUMP_NS
    ahead = transit_ns[1:] < np.minimum.accumulate(transit_ns)[:-1] - _JUMP_NS
    return bool(back.any() or ahead.any())


def axis_traces(run: Run, axis: str) -> AxisTraces:
    """Reads the traces of one axis: commands with the forces that answer them, ages, delays, readback, safety
    states, parameters; times in s since the run's first message.

    Raises:
        RecordingError: a message in the run is not what its topic carries.
    """
    start_ns, end_ns = run_span_ns(run)
    return AxisTraces(
        start_ns=start_ns,
        duration_s=(end_ns - start_ns) * 1e-9,
        session_end_ns=_session_end_ns(run, axis, end_ns),
        commands=_commands(run, axis, start_ns),
        force_age_s=_floats(run, axis, HAPTICS, "force_age_s"),
        delay_s=_delays(run, axis),
        readback_time_s=_time_s(run, axis, FORCE, start_ns),
        readback_m=_floats(run, axis, FORCE, "position_m"),
        states=_states(run, axis, end_ns),
        parameters=_parameters(run, axis, start_ns),
    )


def _commands(run: Run, axis: str, start_ns: int) -> CommandTraces:
    """Traces of the commands, a row for each of the master's samples, with the first valid force that answers
    it or NaN. For `executed` and `followed` invalid answers count, too.
    """
    valid = run.column(axis, FORCE, "valid").astype(bool)
    index, any_index = _answers(run, axis, valid), _answers(run, axis, np.ones_like(valid))
    force_n = np.append(_floats(run, axis, FORCE, "force_n"), np.nan)[index]  # -1: the NaN
    stretch = stretches(run.column(axis, FORCE, "answers_sequence"), run.column(axis, FORCE, "stamp_ns"))
    return CommandTraces(
        time_s=_time_s(run, axis, HAPTICS, start_ns),
        position_m=_floats(run, axis, HAPTICS, "command_position_m"),
        force_n=force_n,
        executed=any_index >= 0,
        followed=of_one_stretch(np.append(stretch, -1)[any_index]),
        **{name: _floats(run, axis, HAPTICS, name) for name in _COLUMNS},
    )


def _answers(run: Run, axis: str, counted: Flags) -> NDArray[np.int64]:
    """Row in the force table, for each command, of the first force marked in `counted` that answers it, by
    session and `answers_stamp_ns`; -1: none does.
    """
    answered_ns = _floats(run, axis, FORCE, "answers_stamp_ns")
    rows = np.flatnonzero(counted & ~np.isnan(answered_ns))
    index = first_answers(
        (run.column(axis, HAPTICS, "session_id"), run.column(axis, HAPTICS, "stamp_ns")),
        (run.column(axis, FORCE, "session_id")[rows], answered_ns[rows]),
        run.column(axis, FORCE, "stamp_ns")[rows],
    )
    return np.append(rows, -1)[index]


def _delays(run: Run, axis: str) -> Floats:
    """Round trips in s, one for each newly answered command: that of the first sample that names it."""
    session_id, answered = (run.column(axis, HAPTICS, name) for name in ("session_id", "answered_sequence"))
    delay_s = _floats(run, axis, HAPTICS, "delay_s")
    rows = np.flatnonzero(np.isfinite(delay_s) & ~np.isnan(answered))
    chosen: Floats = delay_s[rows[first_of_each(session_id[rows], answered[rows])]]
    return chosen


def _states(run: Run, axis: str, end_ns: int) -> list[Span]:
    """Spans of the slave's safety state up to `end_ns`; None where its reports are stale."""
    stale_s = SLAVE_STATE.stale_after_s
    assert stale_s is not None
    states = (message.state for message in run.messages(axis, SLAVE_STATE))
    reports = zip(sent_ns(run, axis, SLAVE_STATE).tolist(), states, strict=True)
    return spans(sorted(reports, key=itemgetter(0)), end_ns, int(stale_s * 1e9))


def _session_end_ns(run: Run, axis: str, end_ns: int) -> int:
    """End of the last session in ns, see `session_end_ns`: by the safety events, the last report of the
    master with a held deadman (or a failed handle), and its last report. `end_ns` where no master was
    recorded.
    """
    reports = [*zip(sent_ns(run, axis, MASTER_STATE).tolist(), run.messages(axis, MASTER_STATE), strict=True)]
    if not reports:
        return end_ns
    # a handle that has failed can not hold the deadman, which is no choice of the operator
    wanted = [at_ns for at_ns, state in reports if state.deadman or state.indication == _HANDLE_FAULT]
    events = zip(sent_ns(run, axis, SAFETY_EVENT).tolist(), run.messages(axis, SAFETY_EVENT), strict=True)
    return session_end_ns(
        sorted(events, key=itemgetter(0)), max(wanted, default=None), max(at_ns for at_ns, _ in reports)
    )


def _parameters(run: Run, axis: str, start_ns: int) -> ParameterTraces | None:
    """Parameters of the model used last, without messages of other models; None where there is none."""
    messages = list(run.messages(axis, PARAMETERS))
    names = messages[-1].names if messages else ()
    rows = [
        i
        for i, message in enumerate(messages)
        if message.names == names and len(message.values) == len(message.standard_deviations) == len(names)
    ]
    if not names or not rows:
        return None
    return ParameterTraces(
        names=names,
        time_s=_time_s(run, axis, PARAMETERS, start_ns)[rows],
        values=np.array([messages[i].values for i in rows], dtype=np.float64),
        standard_deviations=np.array([messages[i].standard_deviations for i in rows], dtype=np.float64),
    )


def _time_s(run: Run, axis: str, topic: Topic[Any], start_ns: int) -> Floats:
    return np.asarray((sent_ns(run, axis, topic) - start_ns) * 1e-9)


def _floats(run: Run, axis: str, topic: Topic[Any], name: str) -> NDArray[np.float64]:
    return run.column(axis, topic, name).astype(np.float64)
