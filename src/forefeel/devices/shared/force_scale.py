"""Readings in N of a load cell's native values, with their flaws. Pure."""

from collections import Counter
from typing import NamedTuple

from forefeel.common.hardware.calibration import LoadCellCalibration
from forefeel.common.messages import within
from forefeel.slave.load_cell import VALID_SHARE, LoadCellReading

_MICRONEWTON_PER_N = 1_000_000  # uN in a N, for the raw counts
_MAX_COUNTS = (1 << 63) - 1  # a message carries raw counts as a signed 64-bit number
_LONGEST_S = 1.0  # s that one value may last
_FEWEST_REPEATS = 30  # repetitions that it takes at least, for slow cells
# share of readings that turn from which a cell is noisy: about half of the 2/3 of white noise
_NOISY_SHARE = 0.3
_NEWEST_WEIGHT = 1 / 50  # weight of the newest reading in the share that turns: a memory of some fifty


class Native(NamedTuple):
    """A measurement in the cell's own unit, its stamp by the host's clock, and its flaws."""

    value: float
    stamp_ns: int
    flaws: tuple[str, ...] = ()


class StuckWatch:
    """Detects one and the same raw value for a second from a cell that is known to be noisy.

    Noise turns: of three values of white noise the middle one is the largest or the least in two of three
    cases. Where less than 0.3 of the last readings (some fifty) turned, the cell may well repeat itself: its
    noise is below its resolution. Motion alone hardly turns.
    """

    def __init__(self, noisy: bool) -> None:
        """`noisy`: whether it is expected to be, before any reading."""
        self._share = 1.0 if noisy else 0.0
        self._noisy = noisy
        self._raw: float | None = None
        self._rising: bool | None = None
        self._since_s, self._repeats = 0.0, 0

    def take(self, raw: float, t_s: float) -> bool:
        """Takes a raw value at `t_s`; True if a noisy cell has repeated it for 1 s, and 30 times. Another
        value restarts the count, and updates whether the cell is noisy: how often its changes turn round.
        """
        if raw == self._raw:
            self._repeats += 1
            return self._noisy and self._repeats >= _FEWEST_REPEATS and t_s - self._since_s >= _LONGEST_S
        if self._raw is not None:
            self._changed(raw > self._raw)
        self._raw, self._since_s, self._repeats = raw, t_s, 0
        return False

    def _changed(self, rising: bool) -> None:
        """Updates the share of readings that turn, and from it whether the cell is noisy."""
        turned = self._rising is not None and rising is not self._rising
        self._rising = rising
        self._share *= (1.0 - _NEWEST_WEIGHT) ** min(self._repeats, 10_000)
        self._share += _NEWEST_WEIGHT * (turned - self._share)
        self._noisy = self._share >= _NOISY_SHARE


class ForceScale:
    """`F = sign (native newton_per_native)`, or the calibration's line instead of the factor.

    Raw counts are micro-newtons before sign and calibration; counts, where the cell has no unit.

    Attributes:
        counters: readings, and those that are not valid by their flaws (`overrange`, `beyond_full_scale`,
            `stuck`, ...).
    """

    def __init__(
        self,
        full_scale_n: float,
        sign: int,
        newton_per_native: float | None,
        calibration: LoadCellCalibration | None,
        stuck: StuckWatch,
        counters: Counter[str],
    ) -> None:
        """`newton_per_native`: None where the cell counts: 0 N without a calibration."""
        self.counters = counters
        self._full_scale_n, self._sign = full_scale_n, sign
        self._newton_per_native, self._calibration = newton_per_native, calibration
        self._stuck = stuck

    def checked(self, native: Native) -> Native:
        """Adds the flaws `beyond_full_scale` and `stuck` where they apply; counts the reading and all its
        flaws. Takes each measurement once, in order; returns it unchanged where no flaw was added.
        """
        flaws, (force_n, raw_n) = native.flaws, self._forces(native.value)
        if max(abs(force_n), abs(raw_n)) > VALID_SHARE * self._full_scale_n:
            flaws = (*flaws, "beyond_full_scale")
        if self._stuck.take(native.value, native.stamp_ns * 1e-9):
            flaws = (*flaws, "stuck")
        self.counters["readings"] += 1
        for flaw in flaws:
            self.counters[flaw] += 1
        return native if flaws is native.flaws else native._replace(flaws=flaws)

    def reading(self, checked: Native) -> LoadCellReading:
        """Converts a measurement to a reading: force in N, clamped to the full scale, and raw counts, which
        are uN for a cell with a unit of force. It is valid if the measurement has no flaws.
        """
        force_n, raw_n = self._forces(checked.value)
        counts = checked.value if self._newton_per_native is None else raw_n * _MICRONEWTON_PER_N
        return LoadCellReading(
            within(force_n, self._full_scale_n),
            round(within(counts, _MAX_COUNTS)),
            not checked.flaws,
            checked.stamp_ns,
        )

    def _forces(self, value: float) -> tuple[float, float]:
        """(force, value by the cell's own unit; 0 where it has none), in N."""
        raw_n = 0.0 if self._newton_per_native is None else value * self._newton_per_native
        return self._sign * (raw_n if self._calibration is None else self._calibration.force_n(value)), raw_n
