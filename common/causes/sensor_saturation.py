"""Flat tops at the end of the load cell's range."""

import numpy as np

from forefeel.common.causes.base import Parameter, SensorEffect
from forefeel.common.causes.offline import Array


class SensorSaturation(SensorEffect):
    """Clips to +- limit_n."""

    name = "sensor_saturation"
    parameters = (Parameter("limit_n", "N", 1e4, 1e-9, 1e6, linear=False),)
    reference = "end of the measuring range"
    fingerprint = "flat tops: many readings at exactly the largest magnitude"
    words = "the end of the load cell's range"

    def _configure(self) -> None:
        self._limit_n = self.values["limit_n"]

    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The force in N, at most the limit in magnitude."""
        return max(-self._limit_n, min(self._limit_n, force_n))

    def _readings(self, t: Array, force_n: Array, dt: Array) -> Array:
        return np.clip(force_n, -self._limit_n, self._limit_n)
