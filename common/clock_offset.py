"""Offset between two hosts' monotonic clocks from four time stamps, with its bound."""

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OffsetEstimate:
    """`offset_ns` = peer's clock minus mine, true to within +-`bound_ns` (half of the round trip)."""

    offset_ns: int
    bound_ns: int

    @property
    def round_trip_ns(self) -> int:
        """The round trip that the estimate rests on."""
        return 2 * self.bound_ns


class ClockOffset:
    """Keeps the exchange with the smallest round trip of the last `window_ns` (Cristian 1989; RFC 5905
    section 10).
    """

    def __init__(self, window_ns: int = 10_000_000_000) -> None:
        self._window_ns = window_ns
        self._exchanges: deque[tuple[int, int, int]] = deque()
        self.best: OffsetEstimate | None = None

    def update(self, t1: int, t2: int, t3: int, t4: int) -> None:
        """One exchange, all in ns: t1 sent (mine), t2 received (peer's), t3 sent back (peer's), t4 received
        (mine).

        Exchanges with a negative round trip (a clock that was set, a forged stamp) are ignored.
        """
        round_trip = (t4 - t1) - (t3 - t2)
        if round_trip < 0 or t4 < t1:
            return
        self._exchanges.append((t4, round_trip, ((t2 - t1) + (t3 - t4)) // 2))
        while self._exchanges[0][0] < t4 - self._window_ns:
            self._exchanges.popleft()
        _, shortest, offset = min(self._exchanges, key=lambda exchange: exchange[1])
        self.best = OffsetEstimate(offset, (shortest + 1) // 2)

    def reset(self) -> None:
        """Forgets everything, as after a new peer."""
        self._exchanges.clear()
        self.best = None
