"""From what a load cell gives to a reading in N that may be believed, or not. Pure."""

from collections import Counter
from typing import NamedTuple

from forefeel.common.hardware.calibration import LoadCellCalibration
from forefeel.common.messages import within
from forefeel.devices.shared.stuck import StuckWatch
from forefeel.slave.load_cell import VALID_SHARE, LoadCellReading

_MICRONEWTON_PER_N = 1_000_000  # uN in a N, for the raw counts
_MAX_COUNTS = (1 << 63) - 1  # a message carries raw counts as a signed 64-bit number


class Native(NamedTuple):
    """A measurement in the cell's own unit, when it was made by the host's clock, and why it is none."""

    value: float
    stamp_ns: int
    flaws: tuple[str, ...] = ()


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
        """`newton_per_native`: None for counts; without a calibration these are no force, 0 N."""
        self.counters = counters
        self._full_scale_n, self._sign = full_scale_n, sign
        self._newton_per_native, self._calibration = newton_per_native, calibration
        self._stuck = stuck

    def checked(self, native: Native) -> Native:
        """With the flaws that only show beside the full scale and the measurements before; each counted."""
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
        """What the control loop gets: finite, never more than the full scale."""
        force_n, raw_n = self._forces(checked.value)
        counts = checked.value if self._newton_per_native is None else raw_n * _MICRONEWTON_PER_N
        return LoadCellReading(
            within(force_n, self._full_scale_n),
            round(within(counts, _MAX_COUNTS)),
            not checked.flaws,
            checked.stamp_ns,
        )

    def _forces(self, value: float) -> tuple[float, float]:
        """In N: the force, and what the cell itself says, 0 where it has no unit."""
        raw_n = 0.0 if self._newton_per_native is None else value * self._newton_per_native
        return self._sign * (raw_n if self._calibration is None else self._calibration.force_n(value)), raw_n
