"""What the event logs and the flight records of both daemons have to say of a fault."""

import re
import time
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from forefeel.common.messages import SafetyState
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import CONTROL_CYCLE, HAPTICS
from tests.event_lines import Event, read_events
from tests.system.faults import required
from tests.system.net.service import AXIS, event_file, flight_files

ROLES = ("slave", "master")
_HELD = frozenset({SafetyState.IDLE, SafetyState.READY})


class Expected:
    """An event that has to be there: `details` match in full, each a regular expression."""

    def __init__(self, role: str, event: str, /, **details: str) -> None:
        self.role, self.event, self.details = role, event, details

    def matches(self, entry: Event) -> bool:
        return entry.event == self.event and all(
            re.fullmatch(pattern, str(entry.details.get(name))) for name, pattern in self.details.items()
        )


def stopped(event: str, reason: str = ".*") -> Expected:
    """The slave's own transition out of motion."""
    return Expected("slave", "safety", event=event, reason=reason)


def heard(event: str) -> Expected:
    """The same as the master heard it."""
    return Expected("master", "slave_safety", event=event)


def judge_logs(
    folder: Path, expected: Sequence[Expected], flights: Sequence[str], since_s: float, stood: str
) -> tuple[str, list[str]]:
    """What both logs hold, and what of it is not as required since then.

    Args:
        flights: the roles of whom a record is due.
        stood: the role that stood still, whose record may be short.
    """
    failures, entries = list[str](), dict[str, list[Event]]()
    for role in ROLES:
        path = event_file(folder, role)
        entries[role] = read_events(path) if path.exists() else []
        if not entries[role] or entries[role][-1].event != "stop":
            failures.append(f"event log of the {role} does not end with a stop")
    for event in expected:
        hits = [entry for entry in entries[event.role] if event.matches(entry)]
        if not any(_written_s(entry) >= since_s for entry in hits):
            last = [f"{entry.event} {dict(entry.details)}"[:120] for entry in entries[event.role][-8:]]
            failures.append(f"no event {event.role} {event.event} {event.details}; {'; '.join(last)}")
    records = 0
    for role in ROLES:
        files = flight_files(folder, role)
        records += len(files)
        if role in flights and not files:
            failures.append(f"no flight record of the {role}")
        least = 1 if role == stood else required.FLOWN
        failures += [f"{path.name} of the {role}: {it}" for path in files for it in _wrong(path, role, least)]
    names = dict.fromkeys(event.details.get("event", event.event).replace("_", " ") for event in expected)
    counts = f"{sum(map(len, entries.values()))} events, {records} flight records"
    return ": ".join(filter(None, [counts, ", ".join(names)])), failures


def _written_s(event: Event) -> float:
    """When, by CLOCK_MONOTONIC: from the wall clock, for a daemon's own clock may have been set."""
    return datetime.fromisoformat(event.utc).timestamp() - time.time() + time.monotonic()


def _wrong(path: Path, role: str, least_ticks: int) -> Iterator[str]:
    """A flight record is whole and leads up to its event; in FAULT and at rest no setpoint moves."""
    run = Run(path)
    if run.truncated:
        yield "truncated"
    ticks = run.count(AXIS, CONTROL_CYCLE if role == "slave" else HAPTICS)
    if ticks < least_ticks:
        yield f"{ticks} ticks only"
    cycles = run.messages(AXIS, CONTROL_CYCLE) if role == "slave" else []
    if any(cycle.moving for cycle in cycles if cycle.state in _HELD):
        yield "a setpoint moves while nothing may"
