"""Forces of one axis: the message for each reading of the load cell, and what the limit may rely on."""

from bisect import bisect_left
from collections import deque
from math import exp, floor, inf, sqrt
from statistics import fmean
from typing import NamedTuple

from forefeel.common.bus import Publisher
from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.events.text import above_limit
from forefeel.common.limiter import OVER_SHARE
from forefeel.common.messages import ForceSample, Grip, MotionCommand
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.stage import StageReading

_REMEMBERED_TICKS = 256  # ticks that are remembered: 0.256 s at 1 kHz
_LATER, _LATER_S, _WORST_OF_S = 1.25, 0.001, 1.0
"""A loop without a real-time kernel, and a cell over USB, are later by so much now and then."""
_NOISES, _ZERO_S = 5.0, 0.25
"""Standard deviations, and the time constant of mean and variance: ten periods of the mains and more."""
_LATE = 2.0
"""By this factor beyond what the limit counts on: 6.5 ms where loop and cell have 1 kHz. The limit itself
holds at any lateness, for it knows the age of each reading."""
_PULL_NS, _CONTACT_NS = 10_000_000, 5_000_000  # for how long a pull, or a first contact, lasts that is one
_BACK_M = 0.002
"""Further back the force may be friction of the way out; nearer, it reverses within presliding, 0.3 mm."""
_PRESLIDING_M = 3e-4
_INWARD_M, _INWARD_M_S = 1e-3, 2e-3
"""Presliding of the presets (force / stiffness); beyond it and the tremor of a hand that holds still."""
_STROKES, _PLACE_M, _LEAST_PLACES = 3, 1e-3, 5
_DRIFT_SHARE, _GIVEN_SHARE = 0.01, 0.15
"""Of the force limit, and of the forces of both ways. What friction takes of the latter is 0.33 to 0.38 in
the arch, 0.7 to 0.8 in coronary vessels, 0.8 to 0.9 in the presets."""
_BLIND_SHARE = 0.9
"""A blind cell may hide that the force grew: from this share of the limit on the stage may only relieve."""


class Instant(NamedTuple):
    """One tick: where the stage was, the command that it executed until then, how far behind the hand (see
    `ControlOutputs`), and the setpoint left of it.
    """

    stamp_ns: int
    stage: StageReading
    executing: MotionCommand | None
    behind_ns: int
    grip: Grip
    setpoint_m: float
    force_limited: bool


class ForcePublisher:
    """Publishes each reading with its own tick of the last 0.25 s: it may come late, or in a batch."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self._instants: deque[Instant] = deque(maxlen=_REMEMBERED_TICKS)

    def note(self, instant: Instant) -> None:
        self._instants.append(instant)

    def send(self, reading: LoadCellReading, holder: int, clock: OffsetEstimate | None) -> None:
        """Publishes one reading as a force sample, with stage, command and setpoint as they were at its stamp
        (without a stamp: at the newest tick). `holder`: session id; `clock`: sent along, not applied. At
        least one tick has to be noted before.
        """
        newest = self._instants[-1]
        at = newest if reading.stamp_ns is None else self._at(reading.stamp_ns)
        executing, answered_ns = at.executing, at.stamp_ns - at.behind_ns
        if executing and executing.recording_time_s is not None:
            answered_ns = executing.stamp_ns  # of its moment is the force that a recorded cell says
        self._publisher.send(
            ForceSample(
                **self._publisher.header(holder, at.stamp_ns),
                position_m=at.stage.position_m,
                velocity_m_s=at.stage.velocity_m_s,
                force_n=reading.force_n,
                raw_counts=reading.raw_counts,
                valid=reading.valid,
                answers_sequence=executing.sequence if executing else None,
                answers_stamp_ns=answered_ns if executing else None,
                recording_time_s=executing.recording_time_s if executing else None,
                gripper=at.grip,
                clock_offset_ns=clock.offset_ns if clock else None,
                clock_bound_ns=clock.bound_ns if clock else None,
                setpoint_m=at.setpoint_m if executing else None,
                force_limited=at.force_limited,
            )
        )

    def _at(self, stamp_ns: int) -> Instant:
        """First tick not before the stamp, restamped to it, its stage interpolated to it. Beyond the
        remembered ticks the newest or the oldest one, restamped only.
        """
        index = bisect_left(self._instants, stamp_ns, key=lambda instant: instant.stamp_ns)
        if index == len(self._instants):
            return self._instants[-1]._replace(stamp_ns=stamp_ns)
        after = self._instants[index]
        if index == 0:
            return after._replace(stamp_ns=stamp_ns)
        before = self._instants[index - 1]
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
        reading_s: what the limit counts on, from the worst of the last second. Grows only while nothing
            follows, so that what becomes late on the way is noticed.
        limit_share: the share of the limit from which on it acts.
        zero_n: mean of the valid readings of the last moments in which nothing followed; None: of none yet.
    """

    def __init__(self, limit_n: float, timeout_s: float | None) -> None:
        """`timeout_s`: how long the cell may stay blind while the stage follows. None: for ever, as a
        recorded force is between its pieces; then a reading counts as it is.
        """
        self.force_n = self.age_s = self.late_s = 0.0
        self.reading_s = _LATER_S
        self.limit_share = 1.0
        self.zero_n: float | None = None
        self._limit_n, self._variance_n2, self._worst_s = limit_n, 0.0, 0.0
        self._timeout_s = timeout_s
        self._stamp_ns = 0
        self._trusted_ns: int | None = None

    @property
    def is_late(self) -> bool:
        return self.late_s > _LATE * (self.reading_s + _LATER_S)

    @property
    def tolerance_n(self) -> float:
        """Largest size of a zero: 5 % of the force limit, or five standard deviations of the noise."""
        return max(OVER_SHARE * self._limit_n, _NOISES * sqrt(self._variance_n2))

    @property
    def is_over(self) -> bool:
        return abs(self.force_n) > (1.0 + OVER_SHARE) * self._limit_n

    def take(
        self, now_ns: int, force_n: float, valid: bool, age_s: float, tick_s: float, follows: bool
    ) -> None:
        """Updates the attributes with the newest reading. A valid one renews the lateness and, while nothing
        follows, zero and noise. An invalid or late one lowers `limit_share`, and its force counts only if it
        is larger than the last (without a timeout it counts like a valid one). `tick_s`: since the last call.
        """
        if valid:
            self.late_s = age_s + tick_s
            self._worst_s = max(self.late_s, self._worst_s * exp(-tick_s / _WORST_OF_S))
            reading_s = _LATER * self._worst_s + _LATER_S
            self.reading_s = min(reading_s, self.reading_s) if follows else reading_s
            if not follows:
                before_n, change_n = self.zero_n or 0.0, force_n - self.force_n
                share = 1.0 if self.zero_n is None else min(1.0, tick_s / _ZERO_S)
                self.zero_n = before_n + share * (force_n - before_n)
                self._variance_n2 += share * (0.5 * (1.0 - share) * change_n * change_n - self._variance_n2)
        if (valid and not self.is_late) or self._timeout_s is None:
            self.force_n, self.limit_share, self._stamp_ns = force_n, 1.0, now_ns - round(age_s * 1e9)
        else:
            self.limit_share = _BLIND_SHARE
            if abs(force_n) > abs(self.force_n):
                self.force_n = force_n
        self.age_s = (now_ns - self._stamp_ns) * 1e-9

    def fault(self, now_ns: int, valid: bool, following: bool) -> str | None:
        """Fault text when the cell was blind, or late, for longer than the timeout while the stage follows;
        else None, and always None without a timeout.
        """
        if (valid and not self.is_late) or self._timeout_s is None or not following:
            self._trusted_ns = now_ns
        elif self._trusted_ns is not None and now_ns - self._trusted_ns > self._timeout_s * 1e9:
            if valid:
                late_ms, counted_ms = 1e3 * self.late_s, 1e3 * self.reading_s
                return f"force {late_ms:.0f} ms late, the limit counts on {counted_ms:.0f} ms: arm again"
            if self.is_over:
                return f"{above_limit(self.force_n, self._limit_n)}: load cell saturated"
            return f"load cell invalid for more than {self._timeout_s:g} s"
        return None


class PushWatch:
    """Detects a pull on the way in of what is only pushed back (`pushes_only`): a fault of the cell.

    Tared by what pulled when the stage began to follow, within what a zero may be off; the force limit counts
    the force as it is. On the way out friction pulls.
    """

    def __init__(self, limit_n: float) -> None:
        self._pull_n = OVER_SHARE * limit_n
        self._tare_n = self._turned_m = 0.0
        self._pushed_ns = 0

    def fault(
        self, now_ns: int, stage: StageReading, force_n: float, valid: bool, following: bool
    ) -> str | None:
        """Fault text when the cell has pulled (force below its tare by a share of the limit) for 10 ms of
        valid readings while the stage moves in; else None. While not `following` it takes the tare: the
        present pull, at most that share.
        """
        x_m, v_m_s = stage
        if valid and not following:
            self._tare_n = max(-self._pull_n, min(0.0, force_n))
        if not following or v_m_s <= 0.0:
            self._turned_m = x_m
        inward = x_m - self._turned_m > _INWARD_M and v_m_s > _INWARD_M_S
        if not valid or not inward or force_n - self._tare_n > -self._pull_n:
            self._pushed_ns = now_ns
        if now_ns - self._pushed_ns < _PULL_NS:
            return None
        return f"load cell pulls with {-force_n:.3g} N on the way in (load_cell.pushes_only): check its sign"


class StrokeWork:
    """Sense of the work that the stage does on the instrument, from its first strokes: forces on the way in
    against those on the way out at the same places.

    What is stored on the way in comes back on the way out, and friction takes: over both the work is positive
    (passivity), with a force of the wrong sign negative. What adheres pulls on the way out: work, too. What a
    drift or a late force may make tells nothing: one that is 10 ms late at 50 mm/s gives back 0.5 mm of its
    way. A beating heart may give in one stroke, not in each.
    """

    def __init__(self, drift_n: float) -> None:
        """`drift_n`: from the way in to the way out, at most."""
        self._drift_n = drift_n
        self._places: dict[int, list[float]] = {}
        self._turned_m: float | None = None
        self._outward = False
        self._negative = 0

    def begin(self) -> None:
        """Forgets the stroke in progress."""
        self._places.clear()
        self._turned_m = None

    def add(self, stage: StageReading, force_n: float) -> int:
        """Adds a tick to the stroke, unless the stage is slower than 2 mm/s. Returns 1 at the end of a stroke
        that the force resisted, -1 at the end of every third that it drove, else 0.
        """
        x_m, v_m_s = stage
        if abs(v_m_s) <= _INWARD_M_S:
            return 0
        farthest, sense = min if self._outward else max, 0
        self._turned_m = x_m if self._turned_m is None else farthest(self._turned_m, x_m)
        if abs(x_m - self._turned_m) > _INWARD_M:
            self._outward, self._turned_m = not self._outward, x_m
            sense = 0 if self._outward else self._sense()
        sums = self._places.setdefault(floor(x_m / _PLACE_M), [0.0] * 4)
        way = 0 if v_m_s > 0.0 else 2
        sums[way] += force_n * abs(v_m_s)
        sums[way + 1] += abs(v_m_s)
        if sense >= 0:
            return sense
        self._negative = (self._negative + 1) % _STROKES
        return -1 if self._negative == 0 else 0

    def _sense(self) -> int:
        """Sense of the work in the stroke that has ended, which is forgotten: 1 where the force resisted, -1
        where it drove, 0 where it tells nothing.
        """
        both = [(i / i_m, o / o_m) for i, i_m, o, o_m in self._places.values() if i_m > 0.0 and o_m > 0.0]
        self._places.clear()
        if len(both) < _LEAST_PLACES:
            return 0
        taken_n = fmean(way_in - way_out for way_in, way_out in both)
        size_n = fmean(abs(way_in) + abs(way_out) for way_in, way_out in both)
        if abs(taken_n) <= max(self._drift_n, _GIVEN_SHARE * size_n):
            return 0
        return 1 if taken_n > 0.0 else -1


class PolarityWatch:
    """Finds a load cell of the wrong sign: the first contact on a way in that began free pushes back. A late
    force may show it on the way back already. A force that the way in begins with tells nothing: then the
    work of the strokes does.
    """

    def __init__(self, limit_n: float, setting: str = "load_cell.sign") -> None:
        """`setting`: where the sign stands, for the text."""
        self._setting, self._work = setting, StrokeWork(_DRIFT_SHARE * limit_n)
        self._free_n = OVER_SHARE * limit_n
        self._start_m = self._deepest_m = 0.0
        self._free_ns = 0
        self._known = self._loaded = False

    def fault(
        self, now_ns: int, stage: StageReading, force_n: float, valid: bool, following: bool, grip: Grip
    ) -> str | None:
        """Fault text when the first contact, of 5 ms, of a way in that began free pulls (`force_n` negative),
        or when the force drove three strokes; else None. A first contact that pushes, or a stroke that the
        force resisted, ends the watch for good. A force that is not `valid` tells nothing.
        """
        if self._known:
            return None
        if self._pulls_first(now_ns, stage.position_m, force_n, valid, following):
            return f"load cell pulls in the first contact: its sign is wrong; change {self._setting}"
        if grip is Grip.OPEN:
            self._work.begin()
        sense = self._work.add(stage, force_n) if valid and following else 0
        self._known = self._known or sense > 0
        if sense >= 0:
            return None
        way = "pulls on the way in and pushes on the way out"
        return f"load cell {way}: its sign is wrong; change {self._setting}"

    def _pulls_first(
        self, now_ns: int, position_m: float, force_n: float, valid: bool, following: bool
    ) -> bool:
        """True if the first contact, of 5 ms, of a way in that began free pulls; if it pushes sets `_known`.
        While not `following` the way begins anew.
        """
        free = valid and abs(force_n) <= self._free_n
        if not following:
            self._start_m, self._deepest_m, self._loaded = position_m, -inf, not free
        self._deepest_m = max(self._deepest_m, position_m)
        came_in = self._deepest_m - self._start_m > _PRESLIDING_M and self._deepest_m - position_m < _BACK_M
        if free or not valid or not came_in or self._loaded:
            self._free_ns = now_ns
        if now_ns - self._free_ns < _CONTACT_NS:
            return False
        self._known = force_n > 0.0
        return not self._known
