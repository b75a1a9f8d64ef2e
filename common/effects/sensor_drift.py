"""Slow ramp of the load cell."""

from common.effects.base import ForceEffect, Parameter


class SensorDrift(ForceEffect):
    """`f = rate_n_s t`, also at no load; t counts from the caller's own zero."""

    name = "sensor_drift"
    site = "sensor"
    parameters = (Parameter("rate_n_s", "N/s", 0.0, -1e3, 1e3),)
    reference = "linear zero drift of the measurement"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(t,)."""
        return (t,)
