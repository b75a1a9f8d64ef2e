"""What the elements of every emulated load cell have in common. Pure."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

FAULTS = "stuck", "overrange", "free"


@dataclass(frozen=True, slots=True)
class Sensing:
    """How a cell sees the force: with white noise of that standard deviation, saturated at full scale."""

    rate_hz: float
    full_scale_n: float = 10.0
    noise_n: float = 0.002
    seed: int = 0


class EmulatedSensor:
    """The element itself: `due` measures at the instants of the cell's own rate.

    Attributes:
        fault: what was provoked; None when nothing was. A cell that sticks repeats what it measured last.
        saturated: whether the last measurement is at the end of the range.
    """

    def __init__(self, sensing: Sensing, feel: Callable[[float], float]) -> None:
        """`feel`: the force in N at a time in s."""
        self.fault: str | None = None
        self.saturated = False
        self._sensing, self._feel, self._random = sensing, feel, Random(f"cell {sensing.seed}")
        self._measured_n, self._count = 0.0, 0

    def provoke(self, fault: str) -> None:
        """Begins one of `FAULTS`; `free` ends it."""
        self.fault = None if fault == "free" else fault

    def measure(self, t_s: float) -> float:
        """The force in N as the cell measures it then."""
        most_n = self._sensing.full_scale_n
        if self.fault != "stuck":
            force_n = self._feel(t_s) + self._random.gauss(0.0, self._sensing.noise_n)
            self._measured_n = most_n if self.fault == "overrange" else min(max(force_n, -most_n), most_n)
            self.saturated = abs(self._measured_n) >= most_n
        return self._measured_n

    def due(self, t_s: float) -> list[tuple[float, float]]:
        """The measurements until then that were not taken yet: (when in s, force in N)."""
        found = []
        while (made_s := (self._count + 1) / self._sensing.rate_hz) <= t_s:
            self._count += 1
            found.append((made_s, self.measure(made_s)))
        return found
