"""What is watched all the time: memory of each process, lateness of the loops, motion of the stage."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from forefeel.common.codec import decode
from forefeel.common.lateness import quantile_us
from forefeel.common.messages import ForceSample, LoopTiming
from forefeel.common.topics import FORCE, MASTER_TIMING, SLAVE_TIMING
from tests.live_cell import AXIS, CELL

_WARM_S = 25.0
_LEAST_S = 30.0
_BLOCK_S = 5.0
_LONG_S = 600.0
_LONG_LIFE_S = 300.0
Second = tuple[int, list[int]]
"""When it ended, and a histogram of the lateness in it."""
_AFTER_NS = 2_000_000_000
_RAMP_NS = 150_000_000
_STILL_M = 5e-6
_UNHEARD = 100  # of the forces in a row: in so many the stage may have been engaged and stopped again
_ROLE_OF = {topic.key(CELL, AXIS): topic.name.partition("/")[0] for topic in (SLAVE_TIMING, MASTER_TIMING)}


@dataclass(slots=True)
class Life:
    """Memory of one process from its start to its end: (seconds of life, MB).

    `warm_s`: from then on it has lived through every kind of fault, and its bounded buffers have been full.
    """

    name: str
    warm_s: float = float("inf")
    samples: list[tuple[float, float]] = field(default_factory=list)

    def growth(self) -> "Growth | None":
        """After the warm-up; None where it lived too shortly."""
        warm = np.array([sample for sample in self.samples if sample[0] > max(_WARM_S, self.warm_s)])
        if len(warm) < 10 or warm[-1, 0] - warm[0, 0] < _LEAST_S:
            return None
        fifth, span_s = len(warm) // 5, float(warm[-1, 0] - warm[0, 0])
        first, last = float(warm[:fifth, 1].mean()), float(warm[-fifth:, 1].mean())
        edges = np.arange(warm[0, 0], warm[-1, 0], _BLOCK_S)
        steps = np.diff(np.interp(edges, warm[:, 0], warm[:, 1]))
        steady_mb_s = float(np.median(steps)) / _BLOCK_S
        return Growth(last, last / first - 1, steady_mb_s * span_s / first, steady_mb_s * 3600, span_s)


@dataclass(frozen=True, slots=True)
class Growth:
    """Of one life: `total`: the last fifth beside the first. `steady`: what the median of its parts of 5 s
    makes in all, to which a leak adds, but not a buffer that a burst fills once.
    """

    resident_mb: float
    total: float
    steady: float
    slope_mb_h: float
    span_s: float

    def share(self) -> float:
        """What is judged: in a short life, in which bursts still fill buffers for the first time, the
        steady part; in a long one all of it.
        """
        return self.steady if self.span_s < _LONG_S else self.total


@dataclass(frozen=True, slots=True)
class Drift:
    """p99 in us of the first and of the last third of a time, and of the empty loop in the same."""

    first_us: float
    last_us: float
    empty_first_us: float
    empty_last_us: float

    def share(self) -> float:
        """By itself or beside the empty loop, whichever is less: what the machine does is not ours."""
        own = self.last_us / self.first_us
        return min(own, own * self.empty_first_us / self.empty_last_us) - 1


class Loops:
    """Lateness of both loops and of the empty one second by second, in each life of a process."""

    def __init__(self) -> None:
        self._last: dict[str, LoopTiming] = {}
        self.lives: dict[str, list[list[Second]]] = {"slave": [], "master": [], "empty": [[]]}

    def heard(self, key: str, payload: bytes, now_ns: int) -> None:
        role, timing = _ROLE_OF[key], decode(LoopTiming, payload)
        before = self._last.get(role)
        self._last[role] = timing
        if before is None or timing.ticks <= before.ticks:
            self.lives[role].append([])
            return
        counts = [b - a for a, b in zip(before.counts, timing.counts, strict=True)]
        self.lives[role][-1].append((now_ns, counts))

    def long_lives(self, role: str) -> list[list[Second]]:
        """Those that are long enough to tell a drift from what the machine does."""
        return [life for life in self.lives[role] if life and life[-1][0] - life[0][0] >= _LONG_LIFE_S * 1e9]

    def drifts(self, role: str, disturbed_ns: Sequence[tuple[int, int]]) -> list[Drift]:
        """Of each long life, or of the longest: another one has another link, and its lateness with it."""
        taken = self.long_lives(role) or [max(self.lives[role], key=len)]
        kept = [calm for life in taken if len(calm := _calm(life, disturbed_ns)) >= 3]
        empty = _calm(self.lives["empty"][0], disturbed_ns)
        return [_drift(seconds, empty) for seconds in kept]


def _calm(seconds: Sequence[Second], disturbed_ns: Sequence[tuple[int, int]]) -> list[Second]:
    """Those in which no fault was, nor shortly before."""
    spans = [(start, end + _AFTER_NS) for start, end in disturbed_ns]
    return [second for second in seconds if not any(start <= second[0] <= end for start, end in spans)]


def _drift(seconds: Sequence[Second], empty: Sequence[Second]) -> Drift:
    third = len(seconds) // 3
    parts = seconds[:third], seconds[-third:]
    beside = [[each for each in empty if part[0][0] <= each[0] <= part[-1][0]] for part in parts]
    return Drift(*(_p99_us(part) for part in (*parts, *beside)))


def _p99_us(seconds: Sequence[Second]) -> float:
    """Median over the seconds: one second that the machine stole is not the loop's drift."""
    return float(np.median([quantile_us(counts, 0.99) for _, counts in seconds]))


class Motion:
    """Where the stage goes while no command is followed: nowhere, once it has come to rest."""

    def __init__(self) -> None:
        self._sequence = self.unheard = 0
        self._since_ns: int | None = None
        self._rest_m: float | None = None
        self.samples = self.resting = 0
        self.moved: list[str] = []

    def heard(self, payload: bytes) -> None:
        sample = decode(ForceSample, payload)
        self.samples += 1
        missed = sample.sequence - self._sequence - 1
        self.unheard += max(missed, 0)
        if not 0 <= missed < _UNHEARD or sample.answers_sequence is not None:
            self._since_ns = self._rest_m = None  # another process, or it follows, or may have followed
        self._sequence = sample.sequence
        if sample.answers_sequence is not None:
            return
        if self._since_ns is None:
            self._since_ns = sample.stamp_ns
        if sample.stamp_ns - self._since_ns < _RAMP_NS:
            return
        self.resting += 1
        self._rest_m = sample.position_m if self._rest_m is None else self._rest_m
        off_m = abs(sample.position_m - self._rest_m)
        if off_m > _STILL_M and len(self.moved) < 100:
            self.moved.append(f"{off_m * 1e6:.0f} um at {sample.stamp_ns / 1e9:.3f} s")


FORCE_KEY = FORCE.key(CELL, AXIS)
TIMING_KEYS = frozenset(_ROLE_OF)
