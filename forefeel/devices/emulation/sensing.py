"""What the elements of every emulated load cell have in common. Pure."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp
from random import Random

from forefeel.common.errors import ConfigurationError

FAULTS = "stuck", "overrange", "free"


@dataclass(frozen=True, slots=True)
class Sensing:
    """How a cell sees the force: white noise (standard deviation), resolution, bias, a first-order filter
    with this delay; beyond the full scale it saturates.
    """

    rate_hz: float
    full_scale_n: float = 10.0
    noise_n: float = 0.002
    resolution_n: float = 0.0
    bias_n: float = 0.0
    filter_delay_s: float = 0.0
    seed: int = 0


class EmulatedSensor:
    """The element itself: `measure` at the instants of the cell's own rate, each in turn.

    Attributes:
        fault: what was provoked; None when nothing was. A cell that sticks repeats what it measured last.
    """

    def __init__(self, sensing: Sensing, feel: Callable[[float], float]) -> None:
        """`feel`: the force in N at a time in s."""
        self.sensing = sensing
        self.fault: str | None = None
        self._feel, self._random = feel, Random(f"cell {sensing.seed}")
        delay_s = sensing.filter_delay_s
        self._keep = exp(-1.0 / (sensing.rate_hz * delay_s)) if delay_s > 0.0 else 0.0
        self._filtered_n: float | None = None
        self._measured_n = 0.0

    def provoke(self, fault: str) -> None:
        """Begins a fault; `free` ends it.

        Raises:
            ConfigurationError: there is no such fault.
        """
        if fault not in FAULTS:
            raise ConfigurationError(
                f"{fault!r}: a load cell has no such fault; expected {', '.join(FAULTS)}"
            )
        self.fault = None if fault == "free" else fault

    def measure(self, t_s: float) -> float:
        """The force in N as the cell measures it then."""
        if self.fault == "stuck":
            return self._measured_n
        most_n = self.sensing.full_scale_n
        force_n = most_n if self.fault == "overrange" else self._noisy(self._feel(t_s))
        self._measured_n = min(max(force_n, -most_n), most_n)
        return self._measured_n

    @property
    def saturated(self) -> bool:
        """Whether the last measurement is at the end of the range."""
        return abs(self._measured_n) >= self.sensing.full_scale_n

    def _noisy(self, force_n: float) -> float:
        before_n = force_n if self._filtered_n is None else self._filtered_n
        self._filtered_n = self._keep * before_n + (1.0 - self._keep) * force_n
        seen_n = self._filtered_n + self.sensing.bias_n + self._random.gauss(0.0, self.sensing.noise_n)
        step_n = self.sensing.resolution_n
        return round(seen_n / step_n) * step_n if step_n > 0.0 else seen_n
