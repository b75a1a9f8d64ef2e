"""The comparison of two hosts' monotonic clocks, and what it says about the age of a message.

Four time stamps of one exchange (Cristian 1989): t1 sent (our clock), t2 received (the peer's), t3 sent back
(the peer's), t4 received (ours). With theta = peer's clock - ours,

    outward transit   t2 - t1 =  theta + d_out        inward transit   t4 - t3 = -theta + d_in
    round trip        r = (t2 - t1) + (t4 - t3) = d_out + d_in
    offset            o = ((t2 - t1) - (t4 - t3)) / 2 = theta + (d_out - d_in) / 2,   |o - theta| <= r / 2

One-way delays can not be measured, but a sum of an inward and an outward transit has no theta in it. So the
age of a message is judged by the round trip that it completes with the newest outward transit:

    excess = (receive - stamp) + (t2 - t1) - min r

It is at least what the message took longer than the fastest one, whatever the offset, however the route is
split, and however fast either clock runs: the outward transit is never older than a second and a round trip.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, sqrt
from typing import Generic, NamedTuple, TypeVar

V = TypeVar("V", int, tuple[int, int])
MAX_RATE_PPM = 1000.0
"""Rate of the peer's clock against ours that is followed: NTP slews by 500 ppm, a crystal adds some 100."""
DRIFT_DIVISOR = round(1e6 / MAX_RATE_PPM)
"""Two clocks part by at most 1 ns in that many."""
_LARGEST_NS = 2**62  # 146 years: a forged stamp, and more than a message could carry
_RECENT_NS = 1_000_000_000
"""Exchanges that say what the path is like now: twenty heartbeats, several correlation times of jitter."""
_SPAN_NS = 200_000_000
"""The fastest message of it each way counts for the rate: four heartbeats, a correlation time of jitter."""
_LOOKED_AT = (15, 30, 75, 300)
"""Numbers of spans that the rate is told from. 3 s find a rate that has just begun: each third has three more
points than a straight line needs. In a minute 5 ms of jitter are some 100 ppm."""
_SPANS_PER_LOOK = 5
"""The rate is worked out once a second."""
_CERTAIN = 6.0
"""Standard errors. Neighbouring spans are correlated, which makes the error half as large again."""


@dataclass(frozen=True, slots=True)
class OffsetEstimate:
    """Estimate of the peer's clock and of the path to it. Stamps of both clocks, in ns.

    Attributes:
        offset_ns: the peer's clock minus ours, true to within +-`bound_ns`.
        bound_ns: half of the round trip, and what the clocks part by since then at `MAX_RATE_PPM`.
        round_trip_ns: smallest round trip of the last second.
        least_round_trip_ns: smallest round trip of the session.
        outward_ns: smallest t2 - t1 of the last second.
        rate_ppm: by how much the peer's clock certainly runs fast (or slow: negative) against ours.
    """

    offset_ns: int
    bound_ns: int
    round_trip_ns: int
    least_round_trip_ns: int
    outward_ns: int
    rate_ppm: float = 0.0

    def ahead_ns(self, inward_ns: int) -> int:
        """Time, at least, by which a message was stamped ahead of our clock; 0 where it may not have been.
        `inward_ns`: its receive stamp minus its stamp.
        """
        # the clocks may have parted since the outward transit, which is up to a second and a round trip old
        parted_ns = (_RECENT_NS + self.round_trip_ns) // DRIFT_DIVISOR
        return max(0, -inward_ns - self.outward_ns - parted_ns)

    def excess_ns(self, inward_ns: int) -> int:
        """Time by which the round trip of a message exceeds the smallest one of the session: `inward_ns`, its
        receive stamp minus its stamp, and the newest outward transit.
        """
        return inward_ns + self.outward_ns - self.least_round_trip_ns


class _Smallest(Generic[V]):
    """Minimum over a sliding window of `span_ns`."""

    def __init__(self, span_ns: int) -> None:
        self._span_ns = span_ns
        self._candidates: deque[tuple[int, V]] = deque()

    def with_newest(self, stamp_ns: int, value: V) -> V:
        """Adds a value; returns the smallest of the window up to `stamp_ns`, which must not go back."""
        candidates = self._candidates
        while candidates and candidates[-1][1] >= value:
            candidates.pop()
        candidates.append((stamp_ns, value))
        while candidates[0][0] < stamp_ns - self._span_ns:
            candidates.popleft()
        return candidates[0][1]


class _Span(NamedTuple):
    """The smallest t2 - t1 and t4 - t3 of one span of time."""

    number: int
    outward_ns: int
    inward_ns: int


class ClockOffset:
    """Estimates the peer's clock in one session: `best`, None until two exchanges have come. Its offset is
    that of the least bound within `window_ns`; a bound grows with its age (RFC 5905, section 10).
    """

    def __init__(self, window_ns: int = 10_000_000_000) -> None:
        self._bounds = _Smallest[tuple[int, int]](window_ns)
        self._round_trips, self._outwards = _Smallest[int](_RECENT_NS), _Smallest[int](_RECENT_NS)
        self._spans: deque[_Span] = deque(maxlen=_LOOKED_AT[-1])
        self._rate_ppm = 0.0
        self._least_round_trip_ns: int | None = None
        self._before: tuple[int, int, int] | None = None
        self.best: OffsetEstimate | None = None

    def update(self, t1: int, t2: int, t3: int, t4: int) -> None:
        """Adds an exchange, t1 to t4 in ns (see the module), and sets `best`, from the second on, to the
        tightest bound of the recent ones. Each direction counts the longer transit of this exchange and the
        one before, so that a single wrong one moves nothing. Ignores an exchange with a negative round trip,
        t3 < t2, or an offset of 146 years: a clock that was set, a forged stamp.
        """
        outward_ns, inward_ns = t2 - t1, t4 - t3
        if outward_ns + inward_ns < 0 or t3 < t2 or abs(outward_ns - inward_ns) > 2 * _LARGEST_NS:
            return
        self._follow_rate(_Span(t4 // _SPAN_NS, outward_ns, inward_ns))
        before, self._before = self._before, (outward_ns, inward_ns, t4)
        if before is None:
            return
        outward_ns, inward_ns = max(outward_ns, before[0]), max(inward_ns, before[1])
        round_trip_ns, offset_ns = outward_ns + inward_ns, (outward_ns - inward_ns) // 2
        least_ns = self._least_round_trip_ns
        least_ns = round_trip_ns if least_ns is None else min(least_ns, round_trip_ns)
        self._least_round_trip_ns = least_ns
        # every bound grows alike, from the older one on: that of t4 is (grown + t4) // DRIFT_DIVISOR
        grown = DRIFT_DIVISOR * ((round_trip_ns + 1) // 2) - before[2]
        grown, offset_ns = self._bounds.with_newest(t4, (grown, offset_ns))
        self.best = OffsetEstimate(
            offset_ns,
            (grown + t4) // DRIFT_DIVISOR,
            self._round_trips.with_newest(t4, round_trip_ns),
            least_ns,
            self._outwards.with_newest(t4, outward_ns),
            self._rate_ppm,
        )

    def _follow_rate(self, span: _Span) -> None:
        """Adds an exchange to the newest span of 0.2 s, which holds the smallest transit in each direction,
        or begins the next one; each fifth span first sets `_rate_ppm` from the spans before it.
        """
        if not self._spans or self._spans[-1].number < span.number:
            if span.number % _SPANS_PER_LOOK == 0:
                self._rate_ppm = _certain_rate_ppm(self._spans)
            self._spans.append(span)
            return
        newest = self._spans[-1]
        self._spans[-1] = _Span(
            newest.number,
            min(newest.outward_ns, span.outward_ns),
            min(newest.inward_ns, span.inward_ns),
        )


def _certain_rate_ppm(spans: Sequence[_Span]) -> float:
    """Largest (by size) of the certain rates of the peer's clock, in ppm, over the last 15, 30, 75 and 300
    spans; 0 where none of them is certain.

    Outward transits grow by the rate and inward ones shrink by it, in every third of the time. A path that
    becomes slower shows in one direction, a clock that was set in one third.
    """
    history = list(spans)
    rates_ppm = [_agreed_rate_ppm(history[-count:]) for count in _LOOKED_AT if len(history) >= count]
    return max(rates_ppm, key=abs, default=0.0)


def _agreed_rate_ppm(spans: Sequence[_Span]) -> float:
    """Rate in ppm between the clocks, shown by both directions in each third of the spans: the smallest, by
    size, of these six; 0 unless all have one sign.
    """
    third = len(spans) // 3
    rates_ppm = [
        _certain_slope(points) * 1e6 / _SPAN_NS
        for thirds in (spans[:third], spans[third:-third], spans[-third:])
        for points in (
            [(span.number, span.outward_ns) for span in thirds],
            [(span.number, -span.inward_ns) for span in thirds],
        )
    ]
    agree = min(rates_ppm) > 0.0 or max(rates_ppm) < 0.0
    return min(rates_ppm, key=abs) if agree else 0.0


def _certain_slope(points: Sequence[tuple[int, int]]) -> float:
    """Slope of the regression line through the (x, y) points, at least three, shrunk by `_CERTAIN` standard
    errors towards 0; 0 where they exceed it.
    """
    count = len(points)
    mean_x, mean_y = sum(x for x, _ in points) / count, sum(y for _, y in points) / count
    centred = [(x - mean_x, y - mean_y) for x, y in points]
    spread = sum(x * x for x, _ in centred)
    slope = sum(x * y for x, y in centred) / spread
    squares = sum((y - slope * x) ** 2 for x, y in centred)
    doubt = _CERTAIN * sqrt(squares / (count - 2) / spread)
    return copysign(max(0.0, abs(slope) - doubt), slope)
