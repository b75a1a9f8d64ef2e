"""Sensing element of every emulated load cell. Pure."""

from collections.abc import Callable
from random import Random

FAULTS = "stuck", "overrange", "free"


class EmulatedSensor:
    """Sensing element, saturated at full scale; `due` measures at the instants of its own rate.

    Args:
        feel: the force in N at a time in s.
        noise_n: standard deviation; a cell without noise can not be seen to stick.

    Attributes:
        fault: what was provoked; None when nothing was. A cell that sticks repeats what it measured last.
        saturated: whether the last measurement is at the end of the range.
    """

    def __init__(
        self,
        feel: Callable[[float], float],
        rate_hz: float,
        full_scale_n: float = 10.0,
        noise_n: float = 0.002,
        seed: int = 0,
    ) -> None:
        self.fault: str | None = None
        self.saturated = False
        self._feel, self._rate_hz, self._full_scale_n, self._noise_n = feel, rate_hz, full_scale_n, noise_n
        self._random = Random(f"cell {seed}")
        self._measured_n, self._count = 0.0, 0

    def provoke(self, fault: str) -> None:
        """Begins one of `FAULTS`; `free` ends it."""
        self.fault = None if fault == "free" else fault

    def measure(self, t_s: float) -> float:
        """Returns the force in N with noise, clamped to the full scale, and sets `saturated` if it reaches
        that. With the fault `stuck` it returns the last one again, with `overrange` the full scale.
        """
        most_n = self._full_scale_n
        if self.fault != "stuck":
            force_n = self._feel(t_s) + self._random.gauss(0.0, self._noise_n)
            self._measured_n = most_n if self.fault == "overrange" else min(max(force_n, -most_n), most_n)
            self.saturated = abs(self._measured_n) >= most_n
        return self._measured_n

    def due(self, t_s: float) -> list[tuple[float, float]]:
        """The measurements until then that were not taken yet: (time in s, force in N)."""
        measured = []
        while (made_s := (self._count + 1) / self._rate_hz) <= t_s:
            self._count += 1
            measured.append((made_s, self.measure(made_s)))
        return measured
