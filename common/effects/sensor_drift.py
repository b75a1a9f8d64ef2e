"""Slow ramp of the load cell."""

from forefeel.common.effects.base import ForceEffect, Parameter
from forefeel.common.effects.offline import Array


class SensorDrift(ForceEffect):
    """`f = rate_n_s t`, also at no load; t counts from the caller's own zero."""

    name = "sensor_drift"
    site = "sensor"
    parameters = (Parameter("rate_n_s", "N/s", 0.0, -1e3, 1e3),)
    reference = "linear zero drift of the measurement"
    fingerprint = "a straight ramp in time that goes on at rest and at no load"

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(t,)."""
        return (t,)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return t[:, None].copy()
