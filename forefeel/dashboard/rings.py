"""The last rows of numbers, in memory that does not grow. Pure."""

import numpy as np

from forefeel.common.error_size import Floats


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
