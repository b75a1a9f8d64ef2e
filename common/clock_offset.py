"""Offset between two hosts' monotonic clocks from four time stamps, with its bound."""

from collections import deque
from dataclasses import dataclass

_LARGEST_NS = 2**62  # 146 years: a forged stamp, and more than a message could carry
DRIFT_DIVISOR = 10_000
"""Two free crystals of 50 ppm part by at most 1 ns in this many."""


@dataclass(frozen=True, slots=True)
class OffsetEstimate:
    """`offset_ns` = peer's clock minus mine, true to within +-`bound_ns`: half of the round trip, and what
    two free clocks part by since that exchange.
    """

    offset_ns: int
    bound_ns: int

    @property
    def round_trip_ns(self) -> int:
        """The round trip that the estimate rests on, at most."""
        return 2 * self.bound_ns


class ClockOffset:
    """Keeps the exchange with the smallest bound of the last `window_ns` (Cristian 1989; RFC 5905 section 10:
    the bound of an exchange grows with its age).
    """

    def __init__(self, window_ns: int = 10_000_000_000) -> None:
        self._window_ns = window_ns
        self._exchanges: deque[tuple[int, int, int]] = deque()
        self.best: OffsetEstimate | None = None

    def update(self, t1: int, t2: int, t3: int, t4: int) -> None:
        """One exchange, all in ns: t1 sent (mine), t2 received (peer's), t3 sent back (peer's), t4 received
        (mine).

        Exchanges that can not be (a negative round trip, an answer before its question: a clock that was set,
        a forged stamp) are ignored.
        """
        round_trip = (t4 - t1) - (t3 - t2)
        offset = ((t2 - t1) + (t3 - t4)) // 2
        if round_trip < 0 or t3 < t2 or abs(offset) > _LARGEST_NS:
            return
        self._exchanges.append((t4, round_trip, offset))
        while self._exchanges[0][0] < t4 - self._window_ns:
            self._exchanges.popleft()
        bound, offset = min(
            ((trip + 1) // 2 + (t4 - then) // DRIFT_DIVISOR, offset) for then, trip, offset in self._exchanges
        )
        self.best = OffsetEstimate(offset, bound)
