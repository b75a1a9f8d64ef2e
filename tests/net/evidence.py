"""What the recordings of both hosts, and the emulated stage itself, say of a fault. Times in s of
CLOCK_MONOTONIC.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.audit import SAFETY
from common.recording.mcap_reader import Run, read_run
from common.topics import COMMAND, FORCE, HAPTICS, SAFETY_EVENT, Topic
from forefeel.local.audit_text import read_entries
from tests.net.provoked import ROW
from tests.net.service import AXIS, audit_file, flight_files, motion_file

S = 1e-9
STILL_M = 10e-6
"""A stage that stays within this has come to rest: ten steps of its encoder."""
STILL_FOR_S = 0.1
_FELT_N = 0.005
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion:
    """Where the stage was. `certain`: told by the stage itself, not by a daemon that may be dead."""

    time_s: Floats
    position_m: Floats
    certain: bool


@dataclass(frozen=True, slots=True)
class Rest:
    """When the stage had come to rest after an instant, None if it never did; and by how much it moved on
    from there without an engagement.
    """

    after_s: float | None
    moved_again_m: float


class Event(NamedTuple):
    """A transition of the slave's safety state machine."""

    event: str
    before: str
    after: str
    reason: str


class Evidence:
    """Everything that was recorded of one fault.

    `step`: a daemon's clock was set, then (role, by how many seconds, when). Its stamps are set right.
    Transitions are those of the slave's audit log, for a recording may miss one; but where its own clock was
    set. Of a master that nobody heard meanwhile its flight records tell.
    """

    def __init__(self, folder: Path, step: tuple[str, float, float] | None = None) -> None:
        self._step = step
        self.slave, self.master = read_run(folder / "slave.mcap"), read_run(folder / "master.mcap")
        self.motion = self._motion(motion_file(folder))
        self._haptics = self._felt([self.master, *map(read_run, flight_files(folder, "master"))])
        stepped = step is not None and step[0] == "slave"
        self.events = self._recorded_events() if stepped else audit_events(folder)

    def _recorded_events(self) -> list[tuple[float, Event]]:
        if not self.slave.axes:
            return []
        told = self.slave.messages(AXIS, SAFETY_EVENT)
        events = [Event(one.event, one.before.value, one.after.value, one.reason) for one in told]
        return list(zip(self._times(self.slave, SAFETY_EVENT).tolist(), events, strict=True))

    def _felt(self, runs: Sequence[Run]) -> tuple[Floats, Floats]:
        """(when, force on the hand) of all haptic ticks that any of them has."""
        runs = [run for run in runs if run.axes]
        time_s = np.concatenate([self._times(run, HAPTICS) for run in runs])
        force_n = np.concatenate([run.column(AXIS, HAPTICS, "rendered_n") for run in runs])
        _, first = np.unique(time_s, return_index=True)
        return time_s[first], np.abs(force_n[first])

    @property
    def stepped(self) -> bool:
        """Whether a clock was set."""
        return self._step is not None

    def _times(self, run: Run, topic: Topic) -> Floats:  # type: ignore[type-arg]
        if AXIS not in run.axes:
            return np.empty(0)
        time_s = np.asarray(run.column(AXIS, topic, "stamp_ns"), dtype=np.float64) * S
        if self._step is None or self._step[0] != topic.publisher or not len(time_s):
            return time_s
        _, step_s, at_s = self._step
        arrived_s: Floats = np.asarray(run.log_ns(AXIS, topic) * S, dtype=np.float64)
        return set_right(time_s, run.column(AXIS, topic, "sequence"), arrived_s, step_s, at_s)

    def _motion(self, path: Path) -> Motion:
        if path.exists():
            size = path.stat().st_size // ROW.size * ROW.size
            rows = np.frombuffer(path.read_bytes()[:size], dtype=[("t", "<i8"), ("x", "<f8"), ("v", "<f8")])
            return Motion(rows["t"] * S, rows["x"].astype(np.float64), True)
        times = self._times(self.slave, FORCE)
        order = np.argsort(times, kind="stable")
        return Motion(times[order], self.slave.column(AXIS, FORCE, "position_m")[order], False)

    def next_event_s(self, name: str, after_s: float) -> float | None:
        """When the slave's safety machine next reported that event."""
        return next(
            (time_s for time_s, event in self.events if event.event == name and time_s > after_s), None
        )

    def end_motion(self, at_s: float) -> None:
        """What a simulated stage did from then on is not its motion: it ended with the slave's process."""
        known = self.motion.time_s < at_s
        self.motion = Motion(self.motion.time_s[known], self.motion.position_m[known], self.motion.certain)

    def rest(self, after_s: float, still_for_s: float = STILL_FOR_S) -> Rest:
        """Of the first stop after that instant, up to the next engagement."""
        until_s = self.next_event_s("engage", after_s) or np.inf
        span = (self.motion.time_s >= after_s) & (self.motion.time_s < until_s)
        return rest(self.motion.time_s[span], self.motion.position_m[span], after_s, still_for_s)

    def moved_while_stopped_m(self, grace_s: float, after_s: float = 0.0) -> float:
        """The most that the stage moved between any stop, `grace_s` later, and the next engagement."""
        worst, stopped_s = 0.0, None
        for time_s, event in [*self.events, (np.inf, None)]:
            if stopped_s is not None and (event is None or event.event == "engage"):
                span = (self.motion.time_s > stopped_s + grace_s) & (self.motion.time_s < time_s)
                moved = self.motion.position_m[span]
                worst = max(worst, float(np.ptp(moved)) if len(moved) else 0.0)
                stopped_s = None
            if event is not None and event.after in ("stopping", "fault", "estopped"):
                stopped_s = stopped_s if stopped_s is not None else time_s
                stopped_s = None if time_s < after_s else stopped_s
        return worst

    def ages_s(self) -> tuple[Floats, Floats]:
        """(when, age) of each command as it began to be executed, by the forces that answer it."""
        columns = [self.slave.column(AXIS, FORCE, name) for name in ("session_id", "answers_sequence")]
        when_s = self._times(self.slave, FORCE)
        answered = np.isfinite(columns[1])
        keys = np.stack([column[answered].astype(np.int64) for column in columns], axis=1)
        when_s, order = when_s[answered], np.argsort(when_s[answered], kind="stable")
        _, first = np.unique(keys[order], axis=0, return_index=True)
        rows = order[first]
        sent_s = self._sent_s(keys, answered)
        known = np.isfinite(sent_s[rows])
        return when_s[rows][known], (when_s - sent_s)[rows][known]

    def _sent_s(self, keys: NDArray[np.int64], answered: NDArray[np.bool_]) -> Floats:
        """When each command was sent: its stamp, or where a clock was set, that of the recorded command."""
        if self._step is None:
            stamps = self.slave.column(AXIS, FORCE, "answers_stamp_ns")[answered]
            return np.asarray(stamps, dtype=np.float64) * S
        names = ("session_id", "sequence")
        sent = [self.master.column(AXIS, COMMAND, name).tolist() for name in names]
        arrived = dict(zip(zip(*sent, strict=True), self._times(self.master, COMMAND).tolist(), strict=True))
        return np.array([arrived.get((a, b), np.nan) for a, b in keys.tolist()])

    def stale_commands(
        self, most_excess_s: float, before_s: float, stood: tuple[float, float] | None = None
    ) -> tuple[int, float]:
        """(how many commands were executed that were older than that above the usual, the largest excess).

        The usual age is the least in the run up to `before_s`. `stood`: from when to when nothing can have
        begun to be executed.
        """
        when_s, age_s = self.ages_s()
        usual_s = float(age_s[when_s < before_s].min())
        if stood is not None:
            age_s = age_s[(when_s < stood[0]) | (when_s > stood[1])]
        return int(np.count_nonzero(age_s - usual_s > most_excess_s)), float(age_s.max() - usual_s)

    def released_between(self, start_s: float, end_s: float) -> bool:
        """Whether the master had let the deadman go then."""
        time_s = self._times(self.master, COMMAND)
        span = (time_s > start_s) & (time_s < end_s)
        return bool((~self.master.column(AXIS, COMMAND, "deadman")[span].astype(bool)).any())

    def rendered_n(self, at_s: float) -> float:
        """The largest force on the hand in the 50 ms before."""
        time_s, force_n = self._haptics
        felt_n = force_n[(time_s > at_s - 0.05) & (time_s <= at_s)]
        return float(felt_n.max()) if len(felt_n) else 0.0

    def faded_after_s(self, at_s: float) -> float | None:
        """How long after that instant the hand still felt something; None when it did not fade.

        Up to the next engagement. A master that publishes nothing any more shows nothing.
        """
        until_s = self.next_event_s("engage", at_s) or np.inf
        time_s, force_n = self._haptics
        span = (time_s > at_s) & (time_s < until_s)
        felt = force_n[span] > _FELT_N
        if not felt.any():
            return 0.0
        last = int(np.flatnonzero(felt)[-1])
        return None if last == len(felt) - 1 else float(time_s[span][last] - at_s)


def audit_events(folder: Path) -> list[tuple[float, Event]]:
    """The slave's transitions by its own audit log, and when they were."""
    entries, _ = read_entries(audit_file(folder, "slave"))
    return [
        (one.noted.monotonic_ns * S, Event(*(str(one.noted.details[name]) for name in Event._fields)))
        for one in entries
        if one.noted.event == SAFETY
    ]


def set_right(
    time_s: Floats, sequence: NDArray[np.int64], arrived_s: Floats, step_s: float, at_s: float
) -> Floats:
    """Stamps of a clock that was set by `step_s` at `at_s`, as if it had not been.

    Up to the first message of a process that was started anew, whose numbers begin again. A clock that was
    set back is told by a stamp before the one that precedes it, or by a message that arrives as much later.
    """
    after = np.flatnonzero((np.diff(sequence, prepend=0) < 0) & (arrived_s > at_s))
    end = int(after[0]) if len(after) else len(time_s)
    stepped = np.zeros(len(time_s), dtype=bool)
    if step_s > 0.0:
        stepped[:end] = time_s[:end] > at_s + 0.5 * step_s
    else:
        back = np.flatnonzero(np.diff(time_s[:end], prepend=time_s[0]) < 0.5 * step_s)
        stepped[int(back[0]) if len(back) else end : end] = True
        if not len(back):  # too few messages to show it
            stepped[:end] = (arrived_s[:end] > at_s) & (arrived_s[:end] - time_s[:end] > 0.9 * abs(step_s))
    return time_s - step_s * stepped


def rest(time_s: Floats, position_m: Floats, after_s: float, still_for_s: float = STILL_FOR_S) -> Rest:
    """What those positions say of the stage's rest, in s after that instant."""
    still = _first_still(time_s, position_m, still_for_s)
    if still is None:
        return Rest(None, 0.0)
    moved_m = np.abs(position_m[still:] - position_m[still])
    return Rest(float(time_s[still] - after_s), float(moved_m.max()))


def _first_still(time_s: Floats, position_m: Floats, still_for_s: float) -> int | None:
    """The first sample from which the stage stays within STILL_M for a while."""
    if not len(time_s):
        return None
    start, n = 0, len(time_s)
    while start < n:
        moved = np.flatnonzero(np.abs(position_m[start:] - position_m[start]) > STILL_M)
        end = n - 1 if not len(moved) else start + int(moved[0])
        if time_s[end] - time_s[start] > still_for_s:
            return start
        start += 1
    return None
