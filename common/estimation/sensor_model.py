"""Predictable part of a model's sensor: its lags and delays, and the end of its range."""

from collections.abc import Callable
from math import inf

from forefeel.common.causes.base import SensorEffect
from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import MotionSample
from forefeel.common.causes.registry import effect_class
from forefeel.common.causes.sensor import SensorSaturation

Sense = Callable[[float, float, float], float]
"""(t s, force N, dt s) -> reading in N."""


class SensorModel:
    """Lags, delays and end of the range of a model's sensor; its other effects are left out.

    Attributes:
        lower_n, upper_n: ends of the range; infinite without a saturation.
    """

    def __init__(self, model: ContactModel) -> None:
        self._linear: list[tuple[type[SensorEffect], dict[str, float]]] = []
        self.lower_n, self.upper_n = -inf, inf
        for entry in model.effects:
            kind, values = effect_class(entry.effect), dict(entry.parameters)
            if issubclass(kind, SensorEffect) and kind.linear:
                self._linear.append((kind, values))
            elif kind is SensorSaturation:
                self.lower_n = max(self.lower_n, -values["lower_n"])
                self.upper_n = min(self.upper_n, values["upper_n"])

    def chain(self) -> Sense:
        """Returns a new chain of lags and delays, at rest: a function (t s, force N, dt s) -> reading in N.

        Its state advances with each call. Without lags and delays it returns the force.
        """
        readings = [kind(**values).reading for kind, values in self._linear]

        def sense(t: float, force_n: float, dt: float) -> float:
            for reading in readings:
                force_n = reading(MotionSample(t, 0.0, 0.0, 0.0, dt), force_n)
            return force_n

        return sense

    def limited(self, force_n: float) -> float:
        return max(self.lower_n, min(self.upper_n, force_n))

    def at_limit(self, force_n: float) -> bool:
        """True if a reading in N is at the end of the range, and so only a bound of the force."""
        return force_n >= 0.999 * self.upper_n or force_n <= 0.999 * self.lower_n
