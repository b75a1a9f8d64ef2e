"""First-order lag of the load cell chain."""

import numpy as np

from forefeel.common.causes.base import Parameter, SensorEffect
from forefeel.common.causes.candidate import Alignment, Extent, Shape, Spectrum, log_grid
from forefeel.common.causes.first_order import FirstOrderLag, lagged
from forefeel.common.causes.offline import Array


def _slow(omega: Array, shape: Shape) -> Spectrum:
    return np.asarray(1.0 / (1.0 + 1j * omega * shape[0]))


def _times(extent: Extent) -> list[Shape]:
    return log_grid(0.1 / extent.cutoff_hz, 0.5, 10)


class SensorLag(SensorEffect):
    """`tau dy/dt = f - y`, tau = time_constant_s, exact for a force constant over dt.

    Starts settled at the first force.
    """

    name = "sensor_lag"
    linear = True
    parameters = (Parameter("time_constant_s", "s", 0.005, 1e-6, 1e3, linear=False),)
    reference = "first-order low-pass filter, zero-order-hold discretisation"
    fingerprint = "the force follows the motion late, and smaller the higher the frequency"
    words = "a load cell that follows slowly"
    equation = ("f read through a lag of {time_constant_s} s",)
    candidates = (
        Alignment(
            shapes=("time_constant_s",), factor=_slow, grid=_times, sizes=("time_constant_s",),
            picture="phase",
        ),
    )  # fmt: skip

    def reset(self) -> None:
        """The next force is taken as settled."""
        self._lag = FirstOrderLag(self.values["time_constant_s"])
        self._settled = False

    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The lagged force in N."""
        if not self._settled:
            self._lag.value, self._settled = force_n, True
        return self._lag.advance(force_n, dt)

    def _readings(self, t: Array, force_n: Array, dt: Array) -> Array:
        return lagged(force_n, dt, self.values["time_constant_s"], float(force_n[0]) if len(force_n) else 0.0)
