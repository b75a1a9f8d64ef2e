"""Error of the predicted force beside that of the late one, over the last seconds. Pure, bounded."""

from collections import deque
from math import sqrt
from typing import NamedTuple

SPAN_S = 20
"""A window of the page: long enough for several ways in and out, short enough to show a change."""
_LEAST = 1000  # forces that were compared, 1 s at 1 kHz


class ErrorPair(NamedTuple):
    """Root mean squares in N, against the measured force of the same command."""

    predicted_n: float
    late_n: float


class Comparison:
    """Sums of squares by whole second, of the last `SPAN_S`."""

    def __init__(self) -> None:
        self._seconds: deque[tuple[int, list[float]]] = deque(maxlen=SPAN_S)

    def add(self, now_s: float, predicted_n: float, late_n: float, measured_n: float) -> None:
        second = int(now_s)
        if not self._seconds or self._seconds[-1][0] != second:
            self._seconds.append((second, [0.0, 0.0, 0.0]))
        sums = self._seconds[-1][1]
        sums[0] += 1
        sums[1] += (predicted_n - measured_n) ** 2
        sums[2] += (late_n - measured_n) ** 2

    def errors(self, now_s: float) -> ErrorPair | None:
        """None: too little was compared lately."""
        recent = [sums for second, sums in self._seconds if second > now_s - SPAN_S]
        count, predicted, late = (
            (sum(column) for column in zip(*recent, strict=True)) if recent else (0, 0, 0)
        )
        return None if count < _LEAST else ErrorPair(sqrt(predicted / count), sqrt(late / count))
