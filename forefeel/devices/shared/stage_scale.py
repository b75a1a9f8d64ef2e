"""Positions of a drive and metres. Pure."""

from typing import NamedTuple


class PositionScale(NamedTuple):
    """`native = zero + per_m * x`, in microsteps or counts; `per_m` has the sign of the axis."""

    zero: float
    per_m: float

    def native(self, x_m: float) -> int:
        """The nearest whole one."""
        return round(self.zero + self.per_m * x_m)

    def metres(self, native: float) -> float:
        """The position in m."""
        return (native - self.zero) / self.per_m

    def ends(self, travel_m: tuple[float, float]) -> tuple[int, int]:
        """A travel in native units, the smaller first."""
        low, high = sorted(self.native(end_m) for end_m in travel_m)
        return low, high
