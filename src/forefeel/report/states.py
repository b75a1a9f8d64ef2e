"""The slave's safety state along time, the end of the last session, and the share of it armed. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from forefeel.common.messages import FOLLOWING, SafetyEvent, SafetyState
from forefeel.slave.safety import SafetyEventName

START_S = 5.0
"""Time that a slave may take from the opened session to the first arming."""


@dataclass(frozen=True, slots=True)
class Span:
    """From `start_ns` to `end_ns` the state was `state`; None: nothing was heard of the slave."""

    start_ns: int
    end_ns: int
    state: SafetyState | None


def spans(reports: Iterable[tuple[int, SafetyState]], end_ns: int, stale_ns: int) -> list[Span]:
    """Spans of the states without gaps, from the first report to `end_ns`; equal neighbours are joined.

    A state lasts until the next report, for `stale_ns` at most, and is None from then on: a slave that was
    killed while armed is not armed any more.
    """
    joined: list[Span] = []
    pieces = list(reports)
    starts_ns = [*(start_ns for start_ns, _ in pieces), end_ns]
    for (start_ns, state), next_ns in zip(pieces, starts_ns[1:], strict=True):
        known_ns = min(next_ns, start_ns + stale_ns)
        _append(joined, Span(start_ns, known_ns, state))
        _append(joined, Span(known_ns, next_ns, None))
    return joined


def _append(joined: list[Span], span: Span) -> None:
    """Appends a span, joined with the last where that has the same state; ignores an empty one."""
    if span.end_ns <= span.start_ns:
        return
    if joined and joined[-1].state is span.state:
        span = Span(joined.pop().start_ns, span.end_ns, span.state)
    joined.append(span)


def session_end_ns(
    transitions: Sequence[tuple[int, SafetyEvent]], wanted_ns: int | None, heard_ns: int
) -> int:
    """Time in ns at which the last session ended; the slave could not have been armed after that.

    It is `wanted_ns` where the operator let go: the slave last left following by a release, and until
    `heard_ns` no event but its coming to rest followed. Else, and without any exit, it is `heard_ns`: after
    another stop the master wants the session back.

    Args:
        transitions: of the slave's safety state, with their times, in order.
        wanted_ns: the last time that the master wanted the slave to follow; None when it never held the
            deadman.
        heard_ns: when the master was heard last.
    """
    exits = [i for i, (_, t) in enumerate(transitions) if t.before in FOLLOWING and t.after not in FOLLOWING]
    if not exits or wanted_ns is None:
        return heard_ns
    (_, left), *later = transitions[exits[-1] :]
    happened = [t for at_ns, t in later if at_ns <= heard_ns and t.event != SafetyEventName.AT_REST]
    return wanted_ns if left.event == SafetyEventName.RELEASE and not happened else heard_ns


def armed_share(states: list[Span], end_ns: int, clutched_s: float) -> float | None:
    """Share of the possible time in which the slave was armed. Possible is the time until `end_ns` from the
    first arming, or from START_S after the session was opened if that is earlier, less `clutched_s`. None
    when never armed, or when no time was possible.

    Args:
        states: spans of the slave's safety state.
        end_ns: when the last session ended.
        clutched_s: time until then that the operator chose to spend with the clutch open. The master sees the
            slave's state late, so a few ms of it may count as armed too; the share is at most 1.
    """
    armed = [span for span in states if span.state is SafetyState.ARMED and span.start_ns < end_ns]
    if not armed:
        return None
    armed_ns = sum(min(span.end_ns, end_ns) - span.start_ns for span in armed)
    opened_ns = next(span.start_ns for span in states if span.state not in (None, SafetyState.IDLE))
    start_ns = min(armed[0].start_ns, opened_ns + int(START_S * 1e9))
    possible_s = (end_ns - start_ns) * 1e-9 - clutched_s
    return min(1.0, armed_ns * 1e-9 / possible_s) if possible_s > 0 else None
