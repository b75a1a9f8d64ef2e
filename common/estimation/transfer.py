"""What of a model.yaml holds for another run, and what this run has to tell anew.

A bias, a drift, the phase of a heartbeat or of the mains, the instant of a change, the grid of the steps and
the instants of spikes belong to the recording that they were found in. All else is the contact and its
sensor. What of the former is linear once its frequency is known becomes columns of time, whose coefficients a
run tells from its own forces.
"""

from collections.abc import Callable, Iterator, Mapping
from math import cos, inf, pi, sin

from forefeel.common.causes.base import SensorEffect
from forefeel.common.causes.model import ContactModel, EffectEntry
from forefeel.common.causes.periodic import PeriodicForce
from forefeel.common.causes.registry import effect_class

OF_ITS_RUN = frozenset(
    {
        "bias",
        "sensor_drift",
        "sensor_spikes",
        "sensor_quantisation",
        "stiffness_change",
        "pulsation",
        "mains_hum",
    }
)
"""Effects whose parameters belong to the run that they were found in."""

_LEAST_RATIO = 0.02
"""A harmonic below this part of its fundamental is not told from noise."""

Sense = Callable[[float, float, float], float]
"""(t s, force N, dt s) -> reading in N."""


def lasting(model: ContactModel) -> ContactModel:
    """The model without what belongs to its run, and with the bias that every load cell has."""
    kept = (entry for entry in model.effects if entry.effect not in OF_ITS_RUN)
    return ContactModel(model.name, (*kept, EffectEntry("bias", (("force_n", 0.0),))))


class SensorColumns:
    """The columns of time that a model names: (t,) of a drift, sin w t and cos w t of each known frequency.

    A phase or a rate is not carried over, a frequency is.
    """

    def __init__(self, model: ContactModel) -> None:
        self._drifts = any(entry.effect == "sensor_drift" for entry in model.effects)
        self._omegas = tuple(
            w for entry in model.effects for w in _omegas(entry.effect, dict(entry.parameters))
        )

    def __len__(self) -> int:
        return self._drifts + 2 * len(self._omegas)

    def at(self, t: float) -> tuple[float, ...]:
        """The columns at time t in s."""
        waves = (wave(w * t) for w in self._omegas for wave in (sin, cos))
        return (t, *waves) if self._drifts else tuple(waves)


def _omegas(effect: str, values: Mapping[str, float]) -> Iterator[float]:
    """The angular frequencies of a periodic force, in rad/s."""
    if not issubclass(effect_class(effect), PeriodicForce):
        return
    w = 2.0 * pi * values["frequency_hz"]
    yield w
    for order, nth in ((2, "second"), (3, "third")):
        if abs(values[f"{nth}_harmonic_ratio"]) > _LEAST_RATIO:
            yield order * w


class SensorModel:
    """What of a model's sensor can be foretold: its lags and delays, and the end of its range.

    Attributes:
        limit_n: the largest reading; infinite without a saturation.
    """

    def __init__(self, model: ContactModel) -> None:
        self._linear: list[tuple[type[SensorEffect], dict[str, float]]] = []
        self.limit_n = inf
        for entry in model.effects:
            kind, values = effect_class(entry.effect), dict(entry.parameters)
            if issubclass(kind, SensorEffect) and kind.linear:
                self._linear.append((kind, values))
            elif kind.name == "sensor_saturation":
                self.limit_n = min(self.limit_n, values["limit_n"])

    @property
    def delays(self) -> bool:
        return bool(self._linear)

    def lines(self, count: int) -> list[Sense]:
        """So many fresh chains of lags and delays, each with a memory of its own, at rest."""
        return [_chained([kind(**values) for kind, values in self._linear]) for _ in range(count)]

    def limited(self, force_n: float) -> float:
        """The force in N within the range."""
        return max(-self.limit_n, min(self.limit_n, force_n))

    def at_limit(self, force_n: float) -> bool:
        """Whether a reading in N tells only that the range has ended."""
        return abs(force_n) >= 0.999 * self.limit_n


def _chained(effects: list[SensorEffect]) -> Sense:
    senses = [effect.sense for effect in effects]

    def sense(t: float, force_n: float, dt: float) -> float:
        for one in senses:
            force_n = one(t, force_n, dt)
        return force_n

    return sense
