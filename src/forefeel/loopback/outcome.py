"""Outcome of a loopback run beside its ten lines: it was never armed, or this host was too slow. Pure."""

from forefeel.common.errors import RunError
from forefeel.common.lateness import FEW_MISSED
from forefeel.common.messages import SafetyState
from forefeel.common.topics import COMMAND
from forefeel.report.model import LoopFigures, RunReport, SafetyNote
from forefeel.report.wording import fault_texts, micros

_STOPPED = frozenset({SafetyState.STOPPING, SafetyState.FAULT, SafetyState.ESTOPPED})


def require_armed(report: RunReport) -> None:
    """Raises RunError, with the cause, when the slave was never armed."""
    if report.armed_share is None:
        causes = [_cause(report), *_lateness(report)]
        raise RunError(f"the slave was never armed: {'; '.join(causes)}")


def amber_lines(report: RunReport) -> list[str]:
    """Lines on a fault of the slave, else on a limit of the force at the hand, and on a host too slow for a
    loop; what became of the motion stands in the ten lines.
    """
    lines = fault_texts(report.safety_events)
    if report.hand_limited and not lines:  # a reversed force is both
        lines.append(report.hand_limited)
    if _is_slow(report.loop.master) or _is_slow(report.loop.slave):
        lines.append(f"This host was too slow for 1 kHz: {'; '.join(_lateness(report))}.")
    return lines


def _is_slow(loop: LoopFigures) -> bool:
    """True where a loop missed too many ticks, or stood still for as long as the watchdog waits."""
    assert COMMAND.stale_after_s is not None
    missed = loop.missed or 0
    stood_still = (loop.max_us or 0.0) > COMMAND.stale_after_s * 1e6
    return stood_still or missed > FEW_MISSED * _due(loop)


def _due(loop: LoopFigures) -> int:
    return (loop.ticks or 0) + (loop.missed or 0)


def _lateness(report: RunReport) -> list[str]:
    """Lines on the missed ticks and the greatest lateness of master and slave; none for one without ticks."""
    ends = (("master", report.loop.master), ("slave", report.loop.slave))
    return [
        f"the {role} missed {loop.missed or 0} of {_due(loop)} ticks and was up to {micros(loop.max_us)} late"
        for role, loop in ends
        if loop.ticks
    ]


def _cause(report: RunReport) -> str:
    """Text on why the slave was not armed: the newest stop or fault that nobody asked for, else the limits
    that refused to engage, else the newest event, else that no session was opened.
    """
    unasked = [note for note in report.safety_events if note.after in _STOPPED and note.event != "release"]
    if unasked:
        return _words(unasked[-1])
    rules = [rule for rule in ("round_trip", "alignment") if f"limit_{rule}" in report.counters]
    if rules:
        return f"it refused to engage because of {' and '.join(rules)}"
    events = [event for event in report.safety_events if event.event != "at_rest"]
    return _words(events[-1]) if events else "no session was opened"


def _words(note: SafetyNote) -> str:
    return f"{note.event} ({note.reason})"
