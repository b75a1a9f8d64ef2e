"""First-order lag of the load cell chain."""

from forefeel.common.effects.base import Parameter, SensorEffect
from forefeel.common.effects.first_order import FirstOrderLag, lagged
from forefeel.common.effects.offline import Array


class SensorLag(SensorEffect):
    """`tau dy/dt = f - y`, tau = time_constant_s, exact for a force constant over dt.

    Starts settled at the first force.
    """

    name = "sensor_lag"
    linear = True
    parameters = (Parameter("time_constant_s", "s", 0.005, 1e-6, 1e3, linear=False),)
    reference = "first-order low-pass filter, zero-order-hold discretisation"
    fingerprint = "the force follows the motion late, and smaller the higher the frequency"

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
