"""Lateness of a fixed-rate loop's wake-ups: a histogram over log-spaced edges, its quantiles, its maximum."""

from bisect import bisect_left

EDGES_US: tuple[float, ...] = tuple(round(10 ** (k / 8), 3) for k in range(49))
"""Upper edges of the bins, 1 us to 1 s, eight to a decade; one more bin counts what is later."""
FEW_MISSED = 0.001
"""Share of missed ticks above which a host counts as slow."""


class Lateness:
    """Counts the lateness of each tick.

    Attributes:
        ticks: ticks that ran.
        missed: deadlines skipped because the tick before was a period or more too late.
        max_us: the worst.
        ended: whether the loop has ended by a fault of its own: no tick follows.
    """

    def __init__(self) -> None:
        self.counts = [0] * (len(EDGES_US) + 1)
        self.ticks = 0
        self.missed = 0
        self.max_us = 0.0
        self.ended = False

    def record(self, late_ns: int) -> None:
        late_us = late_ns * 1e-3
        self.counts[bisect_left(EDGES_US, late_us)] += 1
        self.ticks += 1
        self.max_us = max(self.max_us, late_us)

    def record_on_time(self) -> None:
        self.counts[0] += 1
        self.ticks += 1

    def quantile_us(self, q: float) -> float:
        """Lateness in us that a share `q` of the ticks does not exceed; linear inside a bin."""
        return min(self.max_us, quantile_us(self.counts, q))


def quantile_us(counts: list[int], q: float) -> float:
    """Quantile in us, linear inside a bin of `EDGES_US`; the last edge when it is beyond, 0 when empty."""
    rank = q * sum(counts)
    below = 0
    for index, count in enumerate(counts[:-1]):
        if count and below + count >= rank:
            low = EDGES_US[index - 1] if index else 0.0
            return low + (EDGES_US[index] - low) * max(0.0, rank - below) / count
        below += count
    return EDGES_US[-1] if below < rank else 0.0
