"""Cycles at absolute deadlines."""

from forefeel.common.clock import Clock, MonotonicClock


class Pacer:
    """Sleeps until the next deadline; what has been missed is left out, so that cycles never bunch.

    Attributes:
        missed: deadlines that were left out.
    """

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self._clock, self._period_ns = clock, period_ns
        self._sleeper = MonotonicClock()
        self._deadline_ns = clock.now_ns()
        self.missed = 0

    def wait(self) -> None:
        """Until the next deadline."""
        now_ns = self._clock.now_ns()
        self._deadline_ns += self._period_ns
        late_ns = now_ns - self._deadline_ns
        if late_ns > 0:
            self.missed += 1 + late_ns // self._period_ns
            self._deadline_ns = now_ns + self._period_ns
        self._sleeper.sleep_until_ns(self._sleeper.now_ns() + self._deadline_ns - now_ns)
