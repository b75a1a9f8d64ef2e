"""Force messages: one for each reading of the load cell, with what the stage did when it was made."""

from bisect import bisect_left
from collections import deque
from typing import NamedTuple

from forefeel.common.bus import Publisher
from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.messages import ForceSample, Grip, MotionCommand
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.stage import StageReading

# ticks that are remembered: 0.256 s at 1 kHz; chosen, not measured: an older reading gets the oldest
_REMEMBERED_TICKS = 256


class Instant(NamedTuple):
    """One tick: where the stage was, and the command that it executed until then."""

    stamp_ns: int
    stage: StageReading
    executing: MotionCommand | None
    grip: Grip


class ForcePublisher:
    """Remembers the last quarter of a second of ticks, so that a reading that comes late or in a batch finds
    its own.
    """

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self._instants: deque[Instant] = deque(maxlen=_REMEMBERED_TICKS)

    def note(self, instant: Instant) -> None:
        """The tick of now."""
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
        return Instant(stamp_ns, stage, after.executing, after.grip)
