"""The simulated load cell: filter, offset, drift, noise, the model's own sensor, counts, saturation."""

from collections.abc import Callable
from math import pi
from random import Random

from forefeel.common.causes.numerics import FirstOrderLag
from forefeel.slave.load_cell import VALID_SHARE, LoadCellReading
from forefeel.slave.plant.settings import LoadCellSettings

_PERIOD_S = 1e-3  # s between two conversions, the inverse of `_CONVERSION_RATE_HZ` in `world.py`


class PlantLoadCell:
    """A first-order anti-alias filter at the integration rate, one conversion per ms with white noise.

    `sense`: what else becomes of a reading: (t s, force N, dt s) -> N.
    """

    def __init__(
        self,
        settings: LoadCellSettings,
        seed: int,
        sense: Callable[[float, float, float], float] = lambda t, force_n, dt: force_n,
    ) -> None:
        self._settings = settings
        self._sense = sense
        self._random = Random(seed)
        self._most_counts = 2 ** (settings.bits - 1) - 1
        self._newton_per_count = settings.full_scale_n / self._most_counts
        self.full_scale_n: float = self._most_counts * self._newton_per_count
        self.filtered = FirstOrderLag(1.0 / (2.0 * pi * settings.filter_hz))
        self.reading = LoadCellReading(0.0, 0, False)
        """The newest conversion; invalid before the first."""

    def convert(self, t: float) -> None:
        settings = self._settings
        noise_n = self._random.gauss(0.0, settings.noise_n)
        seen_n = self.filtered.value + settings.bias_n + settings.drift_n_s * t + noise_n
        seen_n = self._sense(t, seen_n, _PERIOD_S)
        most = self._most_counts
        raw = max(-most, min(most, round(seen_n / self._newton_per_count)))
        self.reading = LoadCellReading(raw * self._newton_per_count, raw, abs(raw) <= VALID_SHARE * most)
