"""First-order lag, exact for an input constant over the step: shared by relaxation and sensor chains."""

from math import exp

import numpy as np

from forefeel.common.causes.offline import Array, lazy_kernel


class FirstOrderLag:
    """`tau dy/dt = u - y`, solved exactly: `y(t + dt) = u + (y(t) - u) exp(-dt / tau)`."""

    def __init__(self, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._dt, self._decay = 0.0, 1.0
        self.value = 0.0

    def advance(self, u: float, dt: float) -> float:
        """y after dt; the exponential is computed again only when dt changes."""
        if dt != self._dt:
            self._dt, self._decay = dt, exp(-dt / self._time_constant_s)
        self.value = value = u + (self.value - u) * self._decay
        return value


def lagged(u: Array, dt: Array, time_constant_s: float, start: float = 0.0) -> Array:
    """y after each dt, shape (n,): `FirstOrderLag` over a whole recording, `start` before it."""
    return _recursion(u, np.exp(dt / -time_constant_s), start)


@lazy_kernel
def _recursion(u: Array, decay: Array, start: float) -> Array:
    y = np.empty_like(u)
    value = start
    for i in range(len(u)):
        value = u[i] + (value - u[i]) * decay[i]
        y[i] = value
    return y
