"""Errors of prediction and late force, and the alarm of a model that went wrong. Pure.

A model that went wrong has two signs, each second: the innovation of the identified model (rms, N), and the
share of the measured forces that lie outside of the 95 % band which was drawn for them. Each is compared with
what it was while nothing was amiss; one sign that lasts raises the alarm, and it takes longer without any to
end it.
"""

from collections import deque
from dataclasses import dataclass
from math import sqrt
from statistics import fmean, median
from typing import NamedTuple

_BLOCK_S = 1.0  # s, length of a block that is judged
_LEAST_BLOCKS = 6  # blocks before the usual is known
_KEPT_BLOCKS = 120  # blocks of which the usual is the median: 2 min
_RECENT_BLOCKS = 5  # blocks by which the forces outside of the band are judged without an alarm
_LEAST_FORCES = 100  # forces in a block that is judged
_RISE, _FALL = 2.0, 1.4  # innovation over its usual: bad above the first, fine below the second
# share outside of the band beyond its usual share: bad above the first, fine below the second
_OUTSIDE_RISE, _OUTSIDE_FALL = 0.35, 0.15
_RAISE_BLOCKS, _END_BLOCKS = 2, 5  # bad blocks that raise the alarm, fine ones that end it
COMPARED_S = 20
"""A window of the page: long enough for several ways in and out, short enough to show a change."""
_LEAST = 1000  # forces that were compared, 1 s at 1 kHz


@dataclass(frozen=True, slots=True)
class Signs:
    """Innovation over its usual and share of forces outside of the band in the last second; None: unknown."""

    innovation_ratio: float | None = None
    outside_share: float | None = None


@dataclass(frozen=True, slots=True)
class Alarm:
    """The model is wrong since `since_s`; the worst signs so far."""

    since_s: float
    innovation_ratio: float
    outside_share: float


class ModelWatch:
    """Raises and ends `alarm`, second by second, from times in s that do not go back.

    A second in which too few forces answered a command says nothing: it neither raises nor ends an alarm.
    """

    def __init__(self) -> None:
        self.alarm: Alarm | None = None
        self.signs = Signs()
        self._block: int | None = None
        self._innovations: list[float] = []
        self._forces = self._outside = 0
        self._usual: deque[float] = deque(maxlen=_KEPT_BLOCKS)
        self._usual_outside: deque[float] = deque(maxlen=_KEPT_BLOCKS)
        self._recent: deque[float] = deque(maxlen=_RECENT_BLOCKS)
        self._bad = self._good = 0

    @property
    def misses_band(self) -> bool:
        """True while more forces lie outside of the band than a model that fits leaves there."""
        return fmean(self._recent) > _OUTSIDE_FALL if self._recent else False

    def innovation(self, t_s: float, rms_n: float) -> None:
        self._advance(t_s)
        self._innovations.append(rms_n)

    def force(self, t_s: float, outside: bool) -> None:
        """Counts a measured force that answers a command; `outside`: of the 95 % band drawn for it."""
        self._advance(t_s)
        self._forces += 1
        self._outside += outside

    def _advance(self, t_s: float) -> None:
        """Judges the open block of 1 s and clears its sums once `t_s` is in a later one; opens that."""
        block = int(t_s // _BLOCK_S)
        if self._block is not None and block > self._block:
            self._judge(self._block * _BLOCK_S)
            self._innovations.clear()
            self._forces = self._outside = 0
        self._block = block if self._block is None else max(block, self._block)

    def _judge(self, start_s: float) -> None:
        """Compares rms innovation and share of forces outside the band, in the block from `start_s` on, with
        their medians in usual blocks; updates signs and alarm. Skips a block with under 100 forces or no
        innovation. A block is usual only with no alarm and no bad block counted.
        """
        if self._forces < _LEAST_FORCES or not self._innovations:
            return
        rms_n, share = fmean(self._innovations), self._outside / self._forces
        known = len(self._usual) >= _LEAST_BLOCKS
        usual_n = median(self._usual) if known else rms_n
        ratio = rms_n / usual_n if usual_n > 0 else 1.0
        usual_share = median(self._usual_outside) if known else share
        self.signs = Signs(ratio, share)
        self._recent.append(share)
        if self.alarm is None:
            bad = known and (ratio > _RISE or share > _OUTSIDE_RISE + usual_share)
            self._count_bad(start_s, bad, ratio, share)
        else:
            self._update_alarm(self.alarm, ratio, share, usual_share)
        if self.alarm is None and not self._bad:
            self._usual.append(rms_n)
            self._usual_outside.append(share)

    def _count_bad(self, start_s: float, bad: bool, ratio: float, share: float) -> None:
        """Counts bad blocks in a row; the second raises the alarm, as of the first."""
        self._bad = self._bad + 1 if bad else 0
        if self._bad >= _RAISE_BLOCKS:
            self.alarm = Alarm(start_s - (self._bad - 1) * _BLOCK_S, ratio, share)
            self._bad = self._good = 0

    def _update_alarm(self, alarm: Alarm, ratio: float, share: float, usual_share: float) -> None:
        fine = ratio < _FALL and share < _OUTSIDE_FALL + usual_share
        self._good = self._good + 1 if fine else 0
        worst = max(alarm.innovation_ratio, ratio), max(alarm.outside_share, share)
        self.alarm = None if self._good >= _END_BLOCKS else Alarm(alarm.since_s, *worst)


class ErrorPair(NamedTuple):
    """Root mean squares in N, against the measured force of the same command."""

    predicted_n: float
    late_n: float


class Comparison:
    """Rms errors of prediction and late force over the last `COMPARED_S`, from sums by whole second."""

    def __init__(self) -> None:
        self._seconds: deque[tuple[int, list[float]]] = deque(maxlen=COMPARED_S)

    def add(self, now_s: float, predicted_n: float, late_n: float, measured_n: float) -> None:
        """Adds the squared errors of prediction and late force, against the measured one, to the sums of this
        second; only the last `COMPARED_S` seconds that have any are kept.
        """
        second = int(now_s)
        if not self._seconds or self._seconds[-1][0] != second:
            self._seconds.append((second, [0.0, 0.0, 0.0]))
        sums = self._seconds[-1][1]
        sums[0] += 1
        sums[1] += (predicted_n - measured_n) ** 2
        sums[2] += (late_n - measured_n) ** 2

    def errors(self, now_s: float) -> ErrorPair | None:
        """Errors over the last `COMPARED_S`; None where fewer than 1000 forces were compared."""
        recent = [sums for second, sums in self._seconds if second > now_s - COMPARED_S]
        count, predicted, late = (
            (sum(column) for column in zip(*recent, strict=True)) if recent else (0, 0, 0)
        )
        return None if count < _LEAST else ErrorPair(sqrt(predicted / count), sqrt(late / count))
