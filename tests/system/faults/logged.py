"""What the event logs and the flight records of both daemons have to say of a fault."""

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forefeel.common.messages import SafetyState
from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.common.topics import COMMAND, CONTROL_CYCLE, FORCE, HAPTICS
from tests.event_lines import Event, read_events
from tests.system.faults import required
from tests.system.net.evidence import Evidence, S
from tests.system.net.service import AXIS, event_file, flight_files

ROLES = ("slave", "master")
FLIGHT_S = 2.0
"""Before a fault; it may have begun later, when its daemon did."""
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
        records = f"; {self.flights} flight record{'s' * (self.flights != 1)} agree" if self.flights else ""
        return f"{self.entries} events{': ' * bool(self.said)}{', '.join(self.said)}{records}"


def logged(
    folder: Path, expected: Sequence[Expected], flights: Sequence[str], recorded: Evidence, since_s: float
) -> Found:
    """Whether both logs hold what was expected since then, and each flight record agrees with the
    recordings. `flights`: the roles of whom one is due.
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
    _flown(folder, entries, flights, recorded, found)
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


# --- flight records ---


def _flown(
    folder: Path,
    entries: Mapping[str, Sequence[Event]],
    due: Sequence[str],
    recorded: Evidence,
    found: Found,
) -> None:
    for role in ROLES:
        files = {path.name: path for path in flight_files(folder, role)}
        said = [one.details["file"] for one in entries[role] if one.event == "flight_record"]
        if sorted(files) != sorted(map(str, said)):
            found.failures.append(f"flight records of the {role}: {sorted(files)}, its log says {said}")
        if role in due and not files:
            found.failures.append(f"no flight record of the {role}")
        for path in files.values():
            wrong = [f"{path.name} of the {role}: {what}" for what in _disagrees(path, role, recorded)]
            found.failures += wrong
            found.flights += not wrong


def _disagrees(path: Path, role: str, recorded: Evidence) -> list[str]:
    run = read_run(path)
    if run.truncated:
        return ["truncated"]
    return _slave_disagrees(run, recorded) if role == "slave" else _master_disagrees(run, recorded)


def _master_disagrees(run: Run, recorded: Evidence) -> list[str]:
    """Each of its haptic ticks that was recorded, too, is the same there."""
    names = "stamp_ns", "rendered_n"
    ours, theirs = (
        dict(zip(*(one.column(AXIS, HAPTICS, name).tolist() for name in names), strict=True))
        for one in (run, recorded.master)
    )
    both = ours.keys() & theirs.keys()
    # Of a master that stood still meanwhile the recording has as few.
    since_ns = max(ours, default=0) - required.FLIGHT_NS
    recent = sum(since_ns <= stamp_ns <= since_ns + required.FLIGHT_NS for stamp_ns in theirs)
    wrong = [] if ours and len(ours) >= min(required.FLOWN, recent) else [f"{len(ours)} ticks only"]
    if any(ours[stamp_ns] != theirs[stamp_ns] for stamp_ns in both):
        wrong.append("another force than recorded")
    return wrong


def _slave_disagrees(run: Run, recorded: Evidence) -> list[str]:
    cycles = list(run.messages(AXIS, CONTROL_CYCLE))
    if len(cycles) <= required.FLOWN:
        return [f"{len(cycles)} cycles only"]
    wrong = []
    if any(cycle.moving for cycle in cycles if cycle.state in _HELD):
        wrong.append("a setpoint moves while nothing may")
    off_m = _off_m(run, recorded.slave)
    if off_m > required.READBACK_M:
        wrong.append(f"readback {off_m * 1e3:.3f} mm from the recorded one")
    return wrong + _stale(run, recorded)


def _off_m(flown: Run, recorded: Run) -> float:
    """How far the positions that the forces carry are at most from the readbacks of the cycles around.

    Of a clock that was set back up to there: afterwards its stamps come a second time.
    """
    time_ns, readback_m = (flown.column(AXIS, CONTROL_CYCLE, name) for name in ("stamp_ns", "position_m"))
    force_ns, at_m = (recorded.column(AXIS, FORCE, name) for name in ("stamp_ns", "position_m"))
    cycles, forces = _before_set_back(time_ns), _before_set_back(force_ns)
    time_ns, readback_m, force_ns, at_m = (
        time_ns[:cycles],
        readback_m[:cycles],
        force_ns[:forces],
        at_m[:forces],
    )
    after = np.searchsorted(time_ns, force_ns).clip(1, len(time_ns) - 1)
    near = (time_ns[after] - time_ns[after - 1] < required.GAP_NS) & (force_ns >= time_ns[0])
    known = near & (force_ns <= time_ns[-1])
    off_m = np.abs(at_m - np.interp(force_ns, time_ns, readback_m))[known]
    return float(off_m.max()) if len(off_m) else 0.0


def _before_set_back(stamps_ns: NDArray[np.int64]) -> int:
    """How many come before the clock was set back; messages that overtook each other are no such thing."""
    back = np.flatnonzero(np.diff(stamps_ns) < -required.SET_BACK_NS)
    return int(back[0]) + 1 if len(back) else len(stamps_ns)


def _commands(run: Run) -> dict[tuple[int, int], int]:
    """When each command was sent, by (session, sequence)."""
    session, sequence, stamp_ns = (
        run.column(AXIS, COMMAND, name).tolist() for name in ("session_id", "sequence", "stamp_ns")
    )
    return dict(zip(zip(session, sequence, strict=True), stamp_ns, strict=True))


def _stale(run: Run, recorded: Evidence) -> list[str]:
    """Each command that a cycle executed was sent, and was young as it began to be executed.

    With a clock that was wrong the recording alone tells ages.
    """
    sent_ns = _commands(recorded.master) | _commands(run)
    ages_ns: dict[tuple[int, int], int] = {}
    unknown, begin_ns = 0, run.column(AXIS, CONTROL_CYCLE, "stamp_ns")[0] + required.FLOWN_BEFORE_NS
    for cycle in run.messages(AXIS, CONTROL_CYCLE):
        if cycle.executed_sequence is None:
            continue
        key = cycle.session_id, cycle.executed_sequence
        if key not in sent_ns:
            unknown += cycle.stamp_ns > begin_ns
        elif key not in ages_ns:
            ages_ns[key] = cycle.stamp_ns - sent_ns[key]
    wrong = [f"{unknown} cycles executed what was never sent"] if unknown else []
    if recorded.steered or not ages_ns:
        return wrong
    oldest_s = (max(ages_ns.values()) - min(ages_ns.values())) * S
    if oldest_s > required.STALE_S:
        wrong.append(f"a command executed {oldest_s * 1e3:.0f} ms too old")
    return wrong
