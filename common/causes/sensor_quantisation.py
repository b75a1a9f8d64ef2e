"""Comb of levels of the analogue-to-digital conversion."""

import numpy as np

from forefeel.common.causes.base import Parameter, SensorEffect
from forefeel.common.causes.offline import Array


class SensorQuantisation(SensorEffect):
    """Rounds to the nearest multiple of step_n, halves to even."""

    name = "sensor_quantisation"
    parameters = (Parameter("step_n", "N", 1e-6, 1e-12, 1e3, linear=False),)
    reference = "uniform mid-tread quantiser, Widrow and Kollar, Quantization Noise, 2008"
    fingerprint = "a comb of levels at equal distances in the histogram of the readings"
    words = "coarse steps of the load cell"

    def _configure(self) -> None:
        self._step_n = self.values["step_n"]

    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The nearest level in N."""
        return round(force_n / self._step_n) * self._step_n

    def _readings(self, t: Array, force_n: Array, dt: Array) -> Array:
        return np.rint(force_n / self._step_n) * self._step_n
