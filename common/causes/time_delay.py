"""Force that is stamped late against motion."""

from collections import deque

import numpy as np

from forefeel.common.causes.base import Parameter, SensorEffect
from forefeel.common.causes.candidate import Alignment, Extent, Shape, Spectrum, log_grid
from forefeel.common.causes.offline import Array


def _late(omega: Array, shape: Shape) -> Spectrum:
    return np.asarray(np.exp(-1j * omega * shape[0]))


def _delays(extent: Extent) -> list[Shape]:
    return log_grid(0.1 / extent.cutoff_hz, 0.3, 12)


class TimeDelay(SensorEffect):
    """`y(t) = f(t - delay_s)`, straight between the steps; before its first force that one is taken."""

    name = "time_delay"
    linear = True
    parameters = (Parameter("delay_s", "s", 0.0, 0.0, 10.0, linear=False),)
    reference = "pure transport delay"
    fingerprint = "the force follows the motion late by one time at every frequency, and is as large"
    words = "a force that is stamped late against the motion"
    equation = ("f read {delay_s} s late",)
    candidates = (
        Alignment(shapes=("delay_s",), factor=_late, grid=_delays, sizes=("delay_s",), picture="phase"),
    )

    def _configure(self) -> None:
        self._delay_s = self.values["delay_s"]

    def reset(self) -> None:
        """Forgets the forces on their way."""
        self._past: deque[tuple[float, float]] = deque()

    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The force in N of a delay ago."""
        past, then = self._past, t - self._delay_s
        past.append((t, force_n))
        while len(past) > 1 and past[1][0] <= then:
            past.popleft()
        start, before_n = past[0]
        if then <= start or len(past) == 1:
            return before_n
        end, after_n = past[1]
        return before_n + (after_n - before_n) * (then - start) / (end - start)

    def _readings(self, t: Array, force_n: Array, dt: Array) -> Array:
        return np.interp(t - self._delay_s, t, force_n) if len(t) else force_n
