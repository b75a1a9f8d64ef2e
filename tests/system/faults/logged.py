"""What the event logs and the flight records of both daemons have to say of a fault."""

import re
import time
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
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


@dataclass(frozen=True, slots=True)
class Expected:
    """An event that has to be there: `details` match in full, each a regular expression."""

    role: str
    event: str
    details: Mapping[str, str]

    def matches(self, found: Event) -> bool:
        """Whether it is that one."""
        return found.event == self.event and all(
            re.fullmatch(pattern, str(found.details.get(name))) for name, pattern in self.details.items()
        )

    def __str__(self) -> str:
        words = [self.details.get("event", self.event), *(v for k, v in self.details.items() if k != "event")]
        return f"{self.role}: {' '.join(words)}"


def says(role: str, event: str, /, **details: str) -> Expected:
    """See `Expected`."""
    return Expected(role, event, details)


def stopped(event: str, reason: str = ".*") -> Expected:
    """The slave's own transition out of motion."""
    return says("slave", "safety", event=event, reason=reason)


def heard(event: str) -> Expected:
    """The same as the master heard it."""
    return says("master", "slave_safety", event=event)


@dataclass(slots=True)
class Found:
    """What was found, and what of it is not as required."""

    entries: int = 0
    said: list[str] = field(default_factory=list)
    flights: int = 0
    failures: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        records = f"; {self.flights} flight record{'s' * (self.flights != 1)}" if self.flights else ""
        return f"{self.entries} events{': ' * bool(self.said)}{', '.join(self.said)}{records}"


def logged(
    folder: Path, expected: Sequence[Expected], flights: Sequence[str], since_s: float, stood: Set[str]
) -> Found:
    """Whether both logs hold what was expected since then.

    Args:
        flights: the roles of whom a record is due.
        stood: those of them that stood still, whose record may be short.
    """
    found = Found()
    entries = {role: _events(folder, role, found) for role in ROLES}
    for each in expected:
        hits = [one for one in entries[each.role] if each.matches(one)]
        if not any(_written_s(one) >= since_s for one in hits):
            found.failures.append(f"no event {each}; {_last(entries[each.role])}")
        word = str(each.details.get("event", each.event)).replace("_", " ")
        if word not in found.said:
            found.said.append(word)
    _check_flights(folder, flights, stood, found)
    return found


def _written_s(event: Event) -> float:
    """When, by CLOCK_MONOTONIC: from the wall clock, for a daemon's own clock may have been set."""
    return datetime.fromisoformat(event.utc).timestamp() - time.time() + time.monotonic()


def _events(folder: Path, role: str, found: Found) -> list[Event]:
    path = event_file(folder, role)
    if not path.exists():
        found.failures.append(f"the {role} has no event log")
        return []
    entries = read_events(path)
    found.entries += len(entries)
    if not entries or entries[-1].event != "stop":
        found.failures.append(f"event log of the {role} does not end with a stop")
    return entries


def _last(entries: Sequence[Event]) -> str:
    return "; ".join(f"{one.event} {dict(one.details)}"[:120] for one in entries[-8:])


def _check_flights(folder: Path, due: Sequence[str], stood: Set[str], found: Found) -> None:
    """Each flight record is whole and leads up to its event; in FAULT and at rest no setpoint moves."""
    for role in ROLES:
        files = flight_files(folder, role)
        if role in due and not files:
            found.failures.append(f"no flight record of the {role}")
        for path in files:
            run = Run(path)
            wrong = ["truncated"] if run.truncated else []
            ticks = run.count(AXIS, CONTROL_CYCLE if role == "slave" else HAPTICS)
            if ticks < (1 if role in stood else required.FLOWN):
                wrong.append(f"{ticks} ticks only")
            if role == "slave" and any(
                cycle.moving for cycle in run.messages(AXIS, CONTROL_CYCLE) if cycle.state in _HELD
            ):
                wrong.append("a setpoint moves while nothing may")
            found.failures += [f"{path.name} of the {role}: {what}" for what in wrong]
            found.flights += not wrong
