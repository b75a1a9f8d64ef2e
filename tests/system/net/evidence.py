"""What the recordings of both hosts, and the emulated stage itself, say of a fault. Times in s of
CLOCK_MONOTONIC.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from forefeel.common.events.sink import SAFETY
from forefeel.common.messages import FOLLOWING
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, SAFETY_EVENT, Topic
from tests.event_lines import read_events
from tests.system.net.provoked import ROW
from tests.system.net.service import AXIS, event_file, flight_files, motion_file
from tests.system.net.steered import Steering

S = 1e-9
STILL_M = 10e-6
"""A stage that stays within this has come to rest: ten steps of its encoder."""
STILL_FOR_S = 0.1
FELT_N = 0.005
"""What a hand does not notice."""
_FIRST_S = 1.0
"""Of a session: what waited somewhere before it opened has come by then."""
Floats = NDArray[np.float64]


class Felt(NamedTuple):
    """Haptic ticks in their order: the force on the hand, how old the master says the newest force of the
    slave is (NaN where it does not know), its session.
    """

    time_s: Floats
    force_n: Floats
    age_s: Floats
    session: NDArray[np.int64]


class Event(NamedTuple):
    """A transition of the slave's safety state machine."""

    event: str
    before: str
    after: str
    reason: str


class Evidence:
    """Everything that was recorded of one fault.

    `steered`: a daemon's clock was made wrong, then (role, how, when). Its stamps are set right.
    Transitions are those of the slave's event log, for a recording may miss one; but where its own clock was
    wrong. Of a master that nobody heard meanwhile its flight records tell.
    """

    def __init__(self, folder: Path, steered: tuple[str, Steering, float] | None = None) -> None:
        self.steered = steered
        self.slave, self.master = Run(folder / "slave.mcap"), Run(folder / "master.mcap")
        self._time_s, self._position_m = self._motion(motion_file(folder))
        self._haptics = self._felt([self.master, *map(Run, flight_files(folder, "master"))])
        if steered is not None and steered[0] == "slave":
            recorded = self.slave.messages(AXIS, SAFETY_EVENT) if self.slave.axes else []
            events = [Event(it.event, it.before.value, it.after.value, it.reason) for it in recorded]
            self.events = list(zip(self._times(self.slave, SAFETY_EVENT).tolist(), events, strict=True))
        else:
            entries = [entry for entry in read_events(event_file(folder, "slave")) if entry.event == SAFETY]
            events = [Event(*(str(it.details[name]) for name in Event._fields)) for it in entries]
            self.events = list(zip([it.monotonic_ns * S for it in entries], events, strict=True))

    def _felt(self, runs: Sequence[Run]) -> Felt:
        """All haptic ticks that any of them has."""
        runs = [run for run in runs if run.axes]
        names = "rendered_n", "force_age_s", "session_id"
        columns = [np.concatenate([run.column(AXIS, HAPTICS, name) for run in runs]) for name in names]
        time_s = np.concatenate([self._times(run, HAPTICS) for run in runs])
        _, first = np.unique(time_s, return_index=True)
        force_n, age_s, session = (column[first] for column in columns)
        return Felt(time_s[first], np.abs(force_n), age_s.astype(np.float64), session.astype(np.int64))

    def _times(self, run: Run, topic: Topic) -> Floats:  # type: ignore[type-arg]
        if AXIS not in run.axes:
            return np.empty(0)
        time_s = np.asarray(run.column(AXIS, topic, "stamp_ns"), dtype=np.float64) * S
        if self.steered is None or self.steered[0] != topic.publisher or not len(time_s):
            return time_s
        _, steering, at_s = self.steered
        arrived_s: Floats = np.asarray(run.log_ns(AXIS, topic) * S, dtype=np.float64)
        return set_right(time_s, run.column(AXIS, topic, "sequence"), arrived_s, steering, at_s)

    def _motion(self, path: Path) -> tuple[Floats, Floats]:
        """Times and positions of the stage: its own where it is emulated, else those that the slave told."""
        if path.exists():
            size = path.stat().st_size // ROW.size * ROW.size
            rows = np.frombuffer(path.read_bytes()[:size], dtype=[("t", "<i8"), ("x", "<f8"), ("v", "<f8")])
            return rows["t"] * S, rows["x"].astype(np.float64)
        time_s = self._times(self.slave, FORCE)
        order = np.argsort(time_s, kind="stable")
        return time_s[order], self.slave.column(AXIS, FORCE, "position_m")[order]

    def next_event_s(self, name: str, after_s: float) -> float | None:
        """When the slave's safety machine next reported that event; `name`: a regular expression."""
        later = (event for event in self.events if event[0] > after_s)
        return next((time_s for time_s, event in later if re.fullmatch(name, event.event)), None)

    def following(self, at_s: float) -> bool:
        before = [event for time_s, event in self.events if time_s < at_s]
        return bool(before) and before[-1].after in FOLLOWING

    def rest(self, after_s: float) -> tuple[float, float]:
        """(how long after that instant the stage came to rest, infinite if it never did; by how many m it
        moved on from there). Up to the next engagement.
        """
        until_s = self.next_event_s("engage", after_s) or np.inf
        span = (self._time_s >= after_s) & (self._time_s < until_s)
        time_s, position_m = self._time_s[span], self._position_m[span]
        for start in range(len(time_s)):
            off_m = np.abs(position_m[start:] - position_m[start])
            moved = np.flatnonzero(off_m > STILL_M)
            end = start + int(moved[0]) if len(moved) else len(time_s) - 1
            if time_s[end] - time_s[start] > STILL_FOR_S:
                return float(time_s[start] - after_s), float(off_m.max())
        return np.inf, 0.0

    def moved_while_stopped_m(self, grace_s: float) -> float:
        """The most that the stage moved between any stop, `grace_s` later, and the next engagement."""
        worst_m, stopped_s = 0.0, np.inf
        for time_s, event in [*self.events, (np.inf, None)]:
            if event is None or event.event == "engage":
                moved = self._position_m[(self._time_s > stopped_s + grace_s) & (self._time_s < time_s)]
                worst_m = max(worst_m, float(np.ptp(moved)) if len(moved) else 0.0)
                stopped_s = np.inf
            elif event.after in ("stopping", "fault", "estopped"):
                stopped_s = min(stopped_s, time_s)
        return worst_m

    def executed(self, after_s: float) -> set[int]:
        """The sessions of which a command began to be executed after that instant."""
        return {session for time_s, session in zip(*self._begun()[:2], strict=True) if time_s > after_s}

    def stale_commands(
        self, most_excess_s: float, before_s: float | None, stood: tuple[float, float] | None = None
    ) -> tuple[int, float]:
        """(how many commands were executed that were older than that above the usual, the largest excess).

        The usual age is the least in the run up to `before_s`; None: of each session for itself, see
        `usual_s`. `stood`: from when to when nothing can have begun to be executed.
        """
        when_s, session, sent_s = self._begun()
        excess_s = when_s - sent_s
        if before_s is not None:
            excess_s -= excess_s[when_s < before_s].min()
        else:
            for number in np.unique(session):
                mine = session == number
                excess_s[mine] -= usual_s(when_s[mine], excess_s[mine])
        if stood is not None:
            excess_s = excess_s[(when_s < stood[0]) | (when_s > stood[1])]
        return int(np.count_nonzero(excess_s > most_excess_s)), float(excess_s.max())

    def _begun(self) -> tuple[Floats, NDArray[np.int64], Floats]:
        """(when, session, when it was sent) of each command as it began to be executed, by the forces that
        answer it; in the order of execution.
        """
        columns = [self.slave.column(AXIS, FORCE, name) for name in ("session_id", "answers_sequence")]
        when_s = self._times(self.slave, FORCE)
        answered = np.isfinite(columns[1])
        keys = np.stack([column[answered].astype(np.int64) for column in columns], axis=1)
        when_s, order = when_s[answered], np.argsort(when_s[answered], kind="stable")
        _, first = np.unique(keys[order], axis=0, return_index=True)
        rows = order[first]
        sent_s = self._sent_s(keys, answered)
        known = rows[np.isfinite(sent_s[rows])]
        known = known[np.argsort(when_s[known], kind="stable")]
        return when_s[known], keys[known, 0], sent_s[known]

    def _sent_s(self, keys: NDArray[np.int64], answered: NDArray[np.bool_]) -> Floats:
        """When each command was sent: its stamp, or where a clock was wrong, that of the recorded command."""
        if self.steered is None:
            stamps = self.slave.column(AXIS, FORCE, "answers_stamp_ns")[answered]
            return np.asarray(stamps, dtype=np.float64) * S
        names = ("session_id", "sequence")
        sent = [self.master.column(AXIS, COMMAND, name).tolist() for name in names]
        arrived = dict(zip(zip(*sent, strict=True), self._times(self.master, COMMAND).tolist(), strict=True))
        return np.array([arrived.get((a, b), np.nan) for a, b in keys.tolist()])

    def released_between(self, start_s: float, end_s: float) -> bool:
        """Whether the master had let the deadman go then."""
        time_s = self._times(self.master, COMMAND)
        span = (time_s > start_s) & (time_s < end_s)
        return bool((~self.master.column(AXIS, COMMAND, "deadman")[span].astype(bool)).any())

    def rendered_n(self, at_s: float) -> float:
        """The largest force on the hand in the 50 ms before."""
        felt = self._haptics
        felt_n = felt.force_n[(felt.time_s > at_s - 0.05) & (felt.time_s <= at_s)]
        return float(felt_n.max()) if len(felt_n) else 0.0

    def faded_after_s(self, at_s: float) -> float:
        """How long after that instant the hand still felt something; infinite when it did not fade.

        Up to the next engagement. A master that publishes nothing any more shows nothing.
        """
        until_s = self.next_event_s("engage", at_s) or np.inf
        time_s = self._haptics.time_s
        span = (time_s > at_s) & (time_s < until_s)
        time_s, felt = time_s[span], self._haptics.force_n[span] > FELT_N
        if not felt.any():
            return 0.0
        return np.inf if felt[-1] else float(time_s[felt][-1] - at_s)

    def felt_stale_s(self, stale_s: float, frozen: tuple[float, float] | None = None) -> float:
        """The longest for which the hand felt something after the last force that was not older than that
        above the usual age, see `usual_s`. `frozen`: from when to when the master stood still, which does not
        count.
        """
        felt, longest_s = self._haptics, 0.0
        for session in np.unique(felt.session):
            mine = (felt.session == session) & np.isfinite(felt.age_s)
            time_s, age_s = felt.time_s[mine], felt.age_s[mine]
            if frozen is not None:
                time_s = time_s - np.clip(time_s - frozen[0], 0.0, frozen[1] - frozen[0])
            fresh = age_s - usual_s(time_s, age_s) <= stale_s
            newest_s = np.maximum.accumulate(np.where(fresh, time_s, -np.inf))
            hand = felt.force_n[mine] > FELT_N
            longest_s = max(longest_s, float((time_s - newest_s)[hand].max(initial=0.0)))
        return longest_s

    def clock_bound_s(self, after_s: float) -> tuple[float, float]:
        """(the largest bound that the slave gave for its comparison of the clocks, its largest error).

        Hosts that are namespaces of one machine have one clock: the offset is the error.
        """
        after = self._times(self.slave, FORCE) > after_s
        bound_ns, offset_ns = (
            self.slave.column(AXIS, FORCE, name)[after] for name in ("clock_bound_ns", "clock_offset_ns")
        )
        return float(np.nanmax(bound_ns)) * S, float(np.nanmax(np.abs(offset_ns))) * S


def usual_s(time_s: Floats, age_s: Floats) -> Floats:
    """The usual age in one session at each instant: the least so far, in its first second that of the second.

    So a cable that becomes slower makes everything old until the next session, and one that becomes faster
    does not make old what it carried before.
    """
    least_s = np.minimum.accumulate(age_s)
    early = time_s < time_s[0] + _FIRST_S if len(time_s) else np.zeros(0, dtype=bool)
    least_s[early] = age_s[early].min(initial=np.inf)
    return least_s


def set_right(
    time_s: Floats, sequence: NDArray[np.int64], arrived_s: Floats, steering: Steering, at_s: float
) -> Floats:
    """Stamps of a clock that was wrong from `at_s` on, as if it had not been.

    Up to the first message of a process that was started anew, whose numbers begin again. A clock that was
    set back is told by a stamp before the one that precedes it, or by a message that arrives as much later.
    """
    after = np.flatnonzero((np.diff(sequence, prepend=0) < 0) & (arrived_s > at_s))
    end, step_s = int(after[0]) if len(after) else len(time_s), steering.step_s
    wrong = np.zeros(len(time_s), dtype=bool)
    if step_s >= 0.0:
        wrong[:end] = time_s[:end] > at_s + 0.5 * step_s
    else:
        back = np.flatnonzero(np.diff(time_s[:end], prepend=time_s[0]) < 0.5 * step_s)
        wrong[int(back[0]) if len(back) else end : end] = True
        if not len(back):  # too few messages to show it
            wrong[:end] = (arrived_s[:end] > at_s) & (arrived_s[:end] - time_s[:end] > 0.9 * abs(step_s))
    return np.where(wrong, steering.host_s(time_s, at_s), time_s)
