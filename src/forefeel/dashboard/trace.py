"""A quantity over time: in few points that keep its peaks, or its last values. Pure; memory does not grow."""

from collections import deque
from math import floor, nan
from typing import NamedTuple

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.messages import InstrumentShape

BIN_S = 0.02  # s, of which the lowest and the highest sample are kept
_SHAPES = 400  # that are kept: 20 s, as many as are read before a place in a recording
SPAN_S = 60.0  # s that a trace holds


class Points(NamedTuple):
    """Rows (n, 1 + width) of time in s and values, with numbers from `first` to before `end`."""

    first: int
    end: int
    rows: Floats


class MinMaxTrace:
    """Lowest and highest sample of each bin of time, at their own times, of the last `span_s`.

    Samples come in the order of their time; one that belongs into a bin which is closed is left out. After a
    pause a row of NaN breaks the line.

    Args:
        width: values of a sample; the first one says which is lowest and highest.
    """

    def __init__(self, width: int = 1, bin_s: float = BIN_S, span_s: float = SPAN_S) -> None:
        self.end = 0
        """How many points there have been."""
        self._rows = np.full((2 * round(span_s / bin_s), 1 + width), nan)
        self._bin_s, self._gap = bin_s, max(2, round(GAP_S / bin_s))
        self._bin: int | None = None
        self._low: tuple[float, ...] = ()
        self._high: tuple[float, ...] = ()

    def add(self, t_s: float, *values: float) -> None:
        """Keeps a sample while its first value is the lowest or highest of the open bin, or opens a later bin
        with it; ignores one of an earlier bin.
        """
        number, row = floor(t_s / self._bin_s), (t_s, *values)
        if number == self._bin:
            if row[1] < self._low[1]:
                self._low = row
            elif row[1] > self._high[1]:
                self._high = row
        elif self._bin is None or number > self._bin:
            self._begin(number, row)

    def _begin(self, number: int, row: tuple[float, ...]) -> None:
        """Appends the extremes of the open bin, and NaN after a pause; opens bin `number` with `row`."""
        if self._bin is not None:
            self._append(min(self._low, self._high))
            if self._low is not self._high:
                self._append(max(self._low, self._high))
            if number - self._bin > self._gap:
                self._append((self._bin_s * (self._bin + 1), *(nan for _ in row[1:])))
        self._bin, self._low, self._high = number, row, row

    def _append(self, row: tuple[float, ...]) -> None:
        self._rows[self.end % len(self._rows)] = row
        self.end += 1

    def since(self, number: int) -> Points:
        """The points from that number on, as far as they are kept."""
        first = min(max(number, self.end - len(self._rows), 0), self.end)
        return Points(first, self.end, self._rows[np.arange(first, self.end) % len(self._rows)])


class ShapeTrace:
    """Shapes of the instrument of the last 20 s."""

    def __init__(self) -> None:
        self.end = 0
        """How many there have been."""
        self._rows: deque[tuple[float, list[tuple[float, float]]]] = deque(maxlen=_SHAPES)

    def add(self, t_s: float, shape: InstrumentShape) -> None:
        """Adds the centre line, in hundredths of mm and without its third axis."""
        points = zip(shape.x_m, shape.y_m, strict=False)
        self._rows.append((round(t_s, 3), [(round(1e3 * x, 2), round(1e3 * y, 2)) for x, y in points]))
        self.end += 1

    def since(self, number: int) -> list[tuple[float, list[tuple[float, float]]]]:
        """Time in s and points in mm of the shapes from that number on, as far as they are kept."""
        return list(self._rows)[max(0, number - self.end + len(self._rows)) :]


class SampleRing:
    """The newest `most` rows of `width` numbers."""

    def __init__(self, most: int, width: int) -> None:
        self._rows = np.empty((most, width))
        self._count = 0

    def add(self, *row: float) -> None:
        self._rows[self._count % len(self._rows)] = row
        self._count += 1

    def rows(self) -> Floats:
        """A copy, (n, width), the oldest first."""
        most = len(self._rows)
        first = max(0, self._count - most)
        return self._rows[np.arange(first, self._count) % most]
