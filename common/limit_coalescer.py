"""Interventions, gathered: the first of a rule at once, then at most ten events a second with their count;
none uncounted.
"""

from threading import Lock

from forefeel.common.limiter import LimitHit

# ns, least time between two events of one rule; chosen, not measured: shorter sends more, longer tells later
_INTERVAL_NS = 100_000_000


class LimitCoalescer:
    """Filled by the control loop and by receiving threads, drained on asyncio."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._open: dict[str, tuple[LimitHit, int]] = {}
        self._sent_ns: dict[str, int] = {}
        self.total = 0

    def add(self, hit: LimitHit) -> None:
        """One intervention; the newest of a rule stands for those that it is counted with."""
        with self._lock:
            _, count = self._open.get(hit.rule, (hit, 0))
            self._open[hit.rule] = (hit, count + 1)
            self.total += 1

    def due(self, now_ns: int, last: bool = False) -> list[tuple[LimitHit, int]]:
        """What is to be published now: (newest intervention, how many since the last event of its rule);
        with `last` all there is.
        """
        with self._lock:
            rules = [
                rule
                for rule in self._open
                if last or now_ns - self._sent_ns.get(rule, -_INTERVAL_NS) >= _INTERVAL_NS
            ]
            for rule in rules:
                self._sent_ns[rule] = now_ns
            return [self._open.pop(rule) for rule in rules]
