"""The predictor as the master and the evaluation use it."""

from heapq import heappop, heappush
from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from forefeel.common.estimation.forecast import steps
from forefeel.common.estimation.forecast.bank import RING
from forefeel.common.estimation.forecast.experts import NAMES
from forefeel.common.estimation.forecast.state import new_state

ZOH = "zoh"


class Estimate(NamedTuple):
    """The force now in N, its 95 % band, and the expert that led: one of `NAMES`, or `hold`."""

    force_n: float
    low_n: float
    high_n: float
    leading: str


class Forecaster:
    """Contact force at the own motion of now, learned from forces that arrive late.

    It is not told the delay: it sees what arrives. Stamps are seconds on one clock, that of the own motion.
    Every method is one call of a compiled kernel, which the interpreter lock makes indivisible: `move` and
    `predict` may run in a loop while `observe` runs beside it. Costs some 10 us a tick and as much a force.

    Args:
        outside: how many models from outside take part, whose forces are given to `move`: one that is
            identified, and one as it was loaded, which is trusted until its errors say otherwise.

    Attributes:
        renewals: how often it began anew, for what it had learned was worse than nothing, see `trial`.
    """

    def __init__(self, outside: int = 0) -> None:
        self._outside = outside
        self._state = new_state(outside)
        self._out = np.zeros(3)
        self._early: list[tuple[float, float]] = []
        self._moved_s = -np.inf
        self.renewals = 0

    def move(self, t_s: float, position_m: float, identified_n: float = nan, loaded_n: float = nan) -> None:
        """The own motion at stamp `t_s`. What is not finite, or no later than the last, is left out.

        A pause over 0.1 s begins a new piece: what was learned stays, what the motion has left behind
        (hysteresis, relaxation) does not, and derivatives are taken on either side of it.
        """
        if steps.move(self._state, t_s, position_m, identified_n, loaded_n):
            self._moved_s = t_s
            while self._early and self._early[0][0] <= t_s:
                self._observe(*heappop(self._early))

    def observe(self, stamp_s: float, force_n: float) -> None:
        """A force that was measured at `stamp_s`, the stamp of a `move`; in any order, each at most once.

        One that is ahead of the motion waits for it. One that is not finite, or far from all that were seen
        before, is left out, the latter until the next one confirms it.
        """
        if stamp_s <= self._moved_s:
            self._observe(stamp_s, force_n)
        elif isfinite(stamp_s) and isfinite(force_n) and len(self._early) < RING:
            heappush(self._early, (stamp_s, force_n))

    def _observe(self, stamp_s: float, force_n: float) -> None:
        if not steps.observe(self._state, stamp_s, force_n):
            self._begin_anew()
            steps.observe(self._state, stamp_s, force_n)

    def _begin_anew(self) -> None:
        self._state = new_state(self._outside)
        self.renewals += 1

    def predict(self) -> Estimate | None:
        """The force at the newest `move`; None before any force or any motion."""
        out = self._out
        if not steps.predict(self._state, out):
            return None
        force_n, half_n, leading = out.tolist()
        if not isfinite(abs(force_n) + half_n):
            self._begin_anew()
            return None
        name = ZOH if leading < 0 else NAMES[int(leading)]
        return Estimate(force_n, force_n - half_n, force_n + half_n, name)

    def restart(self) -> None:
        """The next `move` begins a new piece of motion, as after a gap or a new grip."""
        steps.restart(self._state)


def compile_kernels() -> None:
    """Compiles every kernel, or loads what an earlier process compiled; some 20 s the first time."""
    forecaster = Forecaster()
    for n in range(40):
        forecaster.observe((n - 3) * 1e-3, float(n % 5))
        forecaster.move(n * 1e-3, float(n % 7))
        forecaster.predict()
    forecaster.restart()
