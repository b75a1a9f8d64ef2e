"""The text of each event, for the console and the dashboard, and of the quantities in it. Pure.

Texts may hold what came from the network; who shows them makes them `printable`.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from html import escape
from math import floor, log10
from typing import Any

from forefeel.common.messages import (
    EmergencyStop,
    Handshake,
    LimitEvent,
    MasterEvent,
    Message,
    SafetyEvent,
)
from forefeel.common.recording.units import is_angle
from forefeel.common.topics import Topic

UNKNOWN = "–"
ROUND_TRIP, SLOW_LIMIT, NO_FORCE, ZERO = "round_trip", "slow_limit", "no_force", "zero"
"""Rules by which an axis does not arm: the link is too slow, the force limit leaves no speed, the load cell
has given no valid force yet, or reads one though nothing is touched."""
OVER_LIMIT = "over_limit"
SLIPS, BUCKLES, LOOSENS = "wire_slips", "wire_near_buckling", "wire_near_slip"
"""Warnings on the instrument: it slips through the jaws, is near the load at which it bows out, at which it
slips."""
DECLARES = "the first arming declares that the instrument is out of contact"
_ROUND_TRIP = "round trip "
REFUSED = "settings differ", "the slave refuses"
"""Begins of the reason of a master that waiting will not give a session."""
DISTRUSTED = "rendered_late"
"""The rule by which the hand feels the late force, for the prediction is out of reach of it."""
CONTACT_LOST = "contact_lost"
_LIMITED = {
    "workspace": "position kept within the workspace",
    "travel": "position kept within the travel",
    "contact_speed": "slower at the contact",
    "force": "slower towards the force limit",
    "reading_late": "force later than its limit counts on",
    "rendered_force": "force at the hand limited",
    "rendered_step": "force at the hand smoothed",
    "rendered_energy": "force at the hand kept passive",
    DISTRUSTED: "prediction not believed, the late force at the hand",
    CONTACT_LOST: "the wall gave way, what was learned of it is forgotten",
}
"""Effect of a rule on a motion or a force; others are said to be limited."""

WARNINGS = {
    SLIPS: "the wire slips through the gripper",
    BUCKLES: "the wire is about to bow out",
    LOOSENS: "the wire is about to slip through the gripper",
}

_UNITS = ContextVar("units", default=("m", "N"))
PREFIXES = {-3: "n", -2: "µ", -1: "m", 0: ""}


def event_text(message: Message) -> str:
    """Line on a safety, master or limit event, an emergency stop or the answer of a slave to a handshake;
    empty for any other message.
    """
    match message:
        case SafetyEvent() | MasterEvent():
            return f"{message.before} -> {message.after}, {message.event}: {message.reason}"
        case LimitEvent():
            return notable(message.rule, message.requested, message.applied) or _limit(message)
        case EmergencyStop():
            return emergency_stop(message.source, message.reason)
        case Handshake(role="slave"):
            return "session accepted" if message.accepted else f"session refused: {message.reason}"
        case _:
            return ""


def emergency_stop(by: str, reason: str) -> str:
    return f"emergency stop by {by}: {reason}"


def gap(topic: Topic[Message], before: Message | None, state: Message) -> str:
    """Text on an end that was silent for too long between two of its states, by its own clock; else empty."""
    if before is None or topic.stale_after_s is None:
        return ""
    silent_s = (state.stamp_ns - before.stamp_ns) * 1e-9
    return f"{topic.publisher} was silent for {span(silent_s)}" if silent_s > topic.stale_after_s else ""


def not_armed(rule: str, value: float, limit: float) -> str:
    """Line for an axis that does not arm; empty for a rule that does not prevent it."""
    reason = obstacle(rule, value, limit)
    return f"not armed: {reason}" if reason else ""


def above_limit(force_n: float, limit_n: float) -> str:
    return f"force above limit: {quantity(force_n, 'N')}, limit {quantity(limit_n, 'N')}"


def notable(rule: str, value: float, limit: float) -> str:
    """Line on a force above its limit (N), an instrument that gives way (slipped m; force and load in N), or
    an axis that does not arm; empty for other rules.
    """
    if rule == OVER_LIMIT:
        return above_limit(value, limit)
    if rule == SLIPS:
        return f"{WARNINGS[rule]}: {quantity(value, 'm')} so far" if value else WARNINGS[rule]
    if rule in WARNINGS:
        return f"{WARNINGS[rule]}: {quantity(value, 'N')} of {quantity(limit, 'N')}"
    return not_armed(rule, value, limit)


def obstacle(rule: str, value: float, limit: float) -> str:
    """Reason for which an axis does not arm, one line; empty for a rule that does not prevent it. `value` and
    `limit`: in s for ROUND_TRIP, m/s for SLOW_LIMIT, N for ZERO.
    """
    if rule == ROUND_TRIP:
        return long_round_trip(value, limit)
    if rule == SLOW_LIMIT:
        return (
            f"the force limit leaves {value * 1e3:.2g} mm/s, at least {limit * 1e3:g} mm/s are needed: cell "
            "and stage answer too late for limits.stiffest_wall_n_m"
        )
    if rule == NO_FORCE:
        return "load cell has given no valid force: check its cable and its load"
    if rule == ZERO:
        reads, most = quantity(value, "N"), quantity(limit, "N")
        return f"load cell reads {reads} out of contact, at most {most}: tare it, or free the instrument"
    return ""


def long_round_trip(round_trip_s: float, limit_s: float) -> str:
    """Reason for which an axis does not arm over a link that is too slow."""
    return f"{_ROUND_TRIP}{quantity(round_trip_s, 's')}, limit {quantity(limit_s, 's')}"


def is_long_round_trip(reason: str) -> bool:
    return reason.startswith(_ROUND_TRIP)


def _limit(event: LimitEvent) -> str:
    asked, applied = quantity(event.requested, event.unit), quantity(event.applied, event.unit)
    times = f", {event.count} times" if event.count > 1 else ""
    words = _LIMITED.get(event.rule, f"{event.rule.replace('_', ' ')} limited")
    return f"{words}: {applied} in place of {asked}{times}"


@contextmanager
def units_of(*columns: Mapping[Any, str]) -> Iterator[None]:
    """Context in which `shown_unit` and `quantity` show rad for m where all of these recordings have angles,
    and N m for N where all have torques. `columns`: as of a `Recording`, each `unit:column`.
    """
    angles = all(is_angle(recording.get("position", "")) for recording in columns)
    torques = all(recording.get("force", "").partition(":")[0].endswith("m") for recording in columns)
    before = _UNITS.set(("rad" if angles else "m", "N m" if torques else "N"))
    try:
        yield
    finally:
        _UNITS.reset(before)


def shown_unit(unit: str) -> str:
    """Unit as `units_of` has set it: N/m of a rotation is N m/rad, kg is kg m²; else unchanged."""
    length, force = _UNITS.get()
    if unit.endswith("g"):
        return unit + ("", " m", " m²")[(length == "rad") + (force == "N m")]
    return unit.replace("m", length).replace("N", force)


def quantity(value: float | None, unit: str) -> str:
    """Text of `value` with three digits and a prefix from nano to none: 0.0123 N is `12.3 mN`; a dash for
    None. `unit`: of m and N, shown as `shown_unit` has it.
    """
    if value is None:
        return UNKNOWN
    unit = shown_unit(unit)
    if value == 0.0:
        return f"0 {unit}"
    rounded = float(f"{value:.3g}")
    power = power_of_1000(rounded)
    return f"{rounded / 1000.0**power:.3g} {PREFIXES[power]}{unit}"


def power_of_1000(value: float, least: int = -3) -> int:
    """Power of 1000 of the prefix that suits `value`, from `least` to 0."""
    return min(0, max(least, floor(log10(abs(value)) / 3.0 + 1e-9))) if value else 0


def span(seconds: float) -> str:
    """Text of a time that has passed: 3.2 s, 48 s, 2 min 05 s, 1 h 07 min; a negative one is 0.0 s."""
    if seconds < 10.0:
        return f"{max(seconds, 0.0):.1f} s"
    whole = int(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def table_html(text: str) -> str:
    """HTML table, for a notebook, of lines whose label ends in two blanks or more."""
    rows = (re.split(" {2,}", line, maxsplit=1) for line in text.splitlines())
    cells = ("".join(f"<td style='text-align:left'>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"
