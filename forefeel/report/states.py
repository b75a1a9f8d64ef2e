"""The slave's safety state along time, and the share of the time in which it was armed. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass

from common.messages import SafetyState

START_S = 5.0
"""How long a slave may take from the opened session to the first arming."""


@dataclass(frozen=True, slots=True)
class Span:
    """From `start_ns` to `end_ns` the state was `state`; None: nothing was heard of the slave."""

    start_ns: int
    end_ns: int
    state: SafetyState | None


def spans(heard: Iterable[tuple[int, SafetyState]], end_ns: int, stale_ns: int) -> list[Span]:
    """The states as spans without gaps, from the first one heard to `end_ns`.

    A state lasts until the next is heard, for `stale_ns` at most: a slave that was killed while armed is
    not armed any more.
    """
    found: list[Span] = []
    pieces = list(heard)
    starts_ns = [*(start_ns for start_ns, _ in pieces), end_ns]
    for (start_ns, state), next_ns in zip(pieces, starts_ns[1:], strict=True):
        known_ns = min(next_ns, start_ns + stale_ns)
        _append(found, Span(start_ns, known_ns, state))
        _append(found, Span(known_ns, next_ns, None))
    return found


def _append(found: list[Span], span: Span) -> None:
    if span.end_ns <= span.start_ns:
        return
    if found and found[-1].state is span.state:
        span = Span(found.pop().start_ns, span.end_ns, span.state)
    found.append(span)


def armed_share(found: list[Span], clutched_s: float) -> float | None:
    """Time armed over the time that could have been: from the first arming to the end, less `clutched_s`.

    Who has not armed START_S after the session was opened could have.
    `clutched_s`: time that the operator chose to spend with the clutch open. At most 1: as the master sees
    the slave's state late, a few ms of that time may count as armed too. None when never armed.
    """
    armed = [span for span in found if span.state is SafetyState.ARMED]
    if not armed:
        return None
    armed_ns = sum(span.end_ns - span.start_ns for span in armed)
    opened_ns = next(span.start_ns for span in found if span.state not in (None, SafetyState.IDLE))
    start_ns = min(armed[0].start_ns, opened_ns + int(START_S * 1e9))
    possible_s = (found[-1].end_ns - start_ns) * 1e-9 - clutched_s
    return min(1.0, armed_ns * 1e-9 / possible_s) if possible_s > 0 else None
