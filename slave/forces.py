"""Forces of one axis: the message for each reading of the load cell, and what the limit may rely on."""

from bisect import bisect_left
from collections import deque
from typing import NamedTuple

from forefeel.common.bus import Publisher
from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.messages import ForceSample, Grip, MotionCommand
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.stage import StageReading

_REMEMBERED_TICKS = 256  # ticks that are remembered: 0.256 s at 1 kHz
_LATER, _LATER_S, _WORST_OF_NS = 1.25, 0.001, 1_000_000_000
"""A loop without a real-time kernel, and a cell over USB, are later by so much now and then."""
_LATE = 2.0
"""By this factor beyond what the limit counts on: 6.5 ms where loop and cell have 1 kHz. The limit itself
holds at any lateness, for it knows the age of each reading."""
_PULL_SHARE, _PULL_NS = 0.05, 10_000_000  # share of the force limit that is a pull, and for how long
_INWARD_M, _INWARD_M_S = 1e-3, 2e-3
"""Beyond presliding of the presets (force / stiffness 0.3 mm) and the tremor of a hand that holds still."""
_BLIND_SHARE = 0.9
"""A blind cell may hide that the force grew: from this share of the limit on the stage may only relieve."""


class Instant(NamedTuple):
    """One tick: where the stage was, the command that it executed until then, and the setpoint left of it."""

    stamp_ns: int
    stage: StageReading
    executing: MotionCommand | None
    grip: Grip
    setpoint_m: float
    force_limited: bool


class ForcePublisher:
    """Remembers the last quarter of a second of ticks, so that a reading that comes late or in a batch finds
    its own.
    """

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self._instants: deque[Instant] = deque(maxlen=_REMEMBERED_TICKS)

    def note(self, instant: Instant) -> None:
        self._instants.append(instant)

    def send(self, reading: LoadCellReading, holder: int, clock: OffsetEstimate | None) -> None:
        """One message; a reading without a stamp belongs to the newest tick."""
        newest = self._instants[-1]
        at = newest if reading.stamp_ns is None else self._at(reading.stamp_ns)
        executing = at.executing
        self._publisher.send(
            ForceSample(
                **self._publisher.header(holder, at.stamp_ns),
                position_m=at.stage.position_m,
                velocity_m_s=at.stage.velocity_m_s,
                force_n=reading.force_n,
                raw_counts=reading.raw_counts,
                valid=reading.valid,
                answers_sequence=executing.sequence if executing else None,
                answers_stamp_ns=executing.stamp_ns if executing else None,
                recording_time_s=executing.recording_time_s if executing else None,
                gripper=at.grip,
                clock_offset_ns=clock.offset_ns if clock else None,
                clock_bound_ns=clock.bound_ns if clock else None,
                setpoint_m=at.setpoint_m if executing else None,
                force_limited=at.force_limited,
            )
        )

    def _at(self, stamp_ns: int) -> Instant:
        """The tick that ended the span in which the stamp lies, at the stamp; the oldest known for older."""
        found = bisect_left(self._instants, stamp_ns, key=lambda instant: instant.stamp_ns)
        if found == len(self._instants):
            return self._instants[-1]._replace(stamp_ns=stamp_ns)
        after = self._instants[found]
        if found == 0:
            return after._replace(stamp_ns=stamp_ns)
        before = self._instants[found - 1]
        share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        stage = StageReading(*(b + share * (a - b) for b, a in zip(before.stage, after.stage, strict=True)))
        return after._replace(stamp_ns=stamp_ns, stage=stage)


class ForceWatch:
    """Keeps the newest force that can be believed, how late it is, and how long there has been none.

    A reading that is not valid may still say more than the one before: a saturated cell knows the sign, and
    the least size. So until the next valid reading the largest counts. One that is later than `reading_s`
    allows counts as not valid.

    Attributes:
        force_n: the force that the limit respects.
        age_s: its age.
        late_s: of the newest reading when the next tick replaces it.
        reading_s: what the limit counts on, from the worst of the last one to two seconds. Grows only while
            nothing follows, so that what becomes late on the way is noticed.
        limit_share: the share of the limit from which on it acts.
    """

    def __init__(self, timeout_s: float | None) -> None:
        """`timeout_s`: how long the cell may stay blind while the stage follows.

        None: for ever, as a recorded force is between its pieces; then a reading counts as it is.
        """
        self.force_n = self.age_s = self.late_s = 0.0
        self.reading_s = _LATER_S
        self.limit_share = 1.0
        self._worst_s, self._since_ns = (0.0, 0.0), 0
        self._timeout_s = timeout_s
        self._stamp_ns = 0
        self._seen_ns: int | None = None

    @property
    def is_late(self) -> bool:
        return self.late_s > _LATE * (self.reading_s + _LATER_S)

    def take(
        self, now_ns: int, force_n: float, valid: bool, age_s: float, tick_s: float, follows: bool
    ) -> None:
        """The newest reading. `tick_s`: since the last."""
        if valid:
            self._measure(now_ns, age_s + tick_s, follows)
        if (valid and not self.is_late) or self._timeout_s is None:
            self.force_n, self.limit_share, self._stamp_ns = force_n, 1.0, now_ns - round(age_s * 1e9)
        else:
            self.limit_share = _BLIND_SHARE
            if abs(force_n) > abs(self.force_n):
                self.force_n = force_n
        self.age_s = (now_ns - self._stamp_ns) * 1e-9

    def _measure(self, now_ns: int, late_s: float, follows: bool) -> None:
        if now_ns - self._since_ns > _WORST_OF_NS:
            self._worst_s, self._since_ns = (0.0, self._worst_s[0]), now_ns
        self.late_s = late_s
        self._worst_s = max(late_s, self._worst_s[0]), self._worst_s[1]
        reading_s = _LATER * max(self._worst_s) + _LATER_S
        if not follows or reading_s < self.reading_s:
            self.reading_s = reading_s

    def fault(self, now_ns: int, valid: bool, following: bool) -> str | None:
        """Why the stage may not follow any longer: the cell has been blind, or late, for too long."""
        if (valid and not self.is_late) or self._timeout_s is None or not following:
            self._seen_ns = now_ns
        elif self._seen_ns is not None and now_ns - self._seen_ns > self._timeout_s * 1e9:
            if valid:
                late_ms, counted_ms = 1e3 * self.late_s, 1e3 * self.reading_s
                return f"force {late_ms:.0f} ms late, the limit counts on {counted_ms:.0f} ms: arm again"
            return f"load cell invalid for more than {self._timeout_s:g} s"
        return None


class PushWatch:
    """Of an instrument that is only pushed back (`pushes_only`): a pull on its way in is a fault of the cell.

    Tared by what pulled when the stage began to follow. On the way out friction pulls.
    """

    def __init__(self, limit_n: float) -> None:
        self._pull_n = _PULL_SHARE * limit_n
        self._tare_n = self._turned_m = 0.0
        self._pushed_ns = 0

    def fault(self, now_ns: int, stage: StageReading, force_n: float, following: bool) -> str | None:
        """Why the load cell may not be believed any longer."""
        x_m, v_m_s = stage
        if not following:
            self._tare_n = min(0.0, force_n)
        if not following or v_m_s <= 0.0:
            self._turned_m = x_m
        inward = x_m - self._turned_m > _INWARD_M and v_m_s > _INWARD_M_S
        if not inward or force_n - self._tare_n > -self._pull_n:
            self._pushed_ns = now_ns
        if now_ns - self._pushed_ns < _PULL_NS:
            return None
        return f"load cell pulls with {-force_n:.3g} N on the way in (load_cell.pushes_only): check its sign"
