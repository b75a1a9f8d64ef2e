"""A load cell that repeats itself though it has noise. Pure."""

_LONGEST_S = 1.0  # s that one value may last
_FEWEST_REPEATS = 30  # repetitions that it takes at least, for slow cells
# share of readings that turn from which a cell is noisy: about half of the 2/3 of white noise
_NOISY_SHARE = 0.3
_NEWEST_WEIGHT = 1 / 50  # weight of the newest reading in the share that turns: a memory of some fifty


class StuckWatch:
    """Says when one and the same raw value came for a second from a cell that is known to be noisy.

    Noise turns: of three values of white noise the middle one is the largest or the least in two of three
    cases. Where less than 0.3 of the last readings (some fifty) turned, the cell may well repeat itself: its
    noise is below its resolution. Motion alone hardly turns.
    """

    def __init__(self, noisy: bool) -> None:
        """`noisy`: whether it is expected before it was seen."""
        self._share = 1.0 if noisy else 0.0
        self._noisy = noisy
        self._raw: float | None = None
        self._rising: bool | None = None
        self._since_s, self._repeats = 0.0, 0

    def take(self, raw: float, t_s: float) -> bool:
        """Whether this reading only repeats those before it, for too long."""
        if raw == self._raw:
            self._repeats += 1
            return self._noisy and self._repeats >= _FEWEST_REPEATS and t_s - self._since_s >= _LONGEST_S
        if self._raw is not None:
            self._changed(raw > self._raw)
        self._raw, self._since_s, self._repeats = raw, t_s, 0
        return False

    def _changed(self, rising: bool) -> None:
        turned = self._rising is not None and rising is not self._rising
        self._rising = rising
        self._share *= (1.0 - _NEWEST_WEIGHT) ** min(self._repeats, 10_000)
        self._share += _NEWEST_WEIGHT * (turned - self._share)
        self._noisy = self._share >= _NOISY_SHARE
