"""Times at which a device made its readings, by the host's clock. Pure."""

from collections import Counter
from collections.abc import Sequence

from forefeel.common.errors import DeviceError

_WRAP_US = 1 << 32  # us after which a device's clock begins anew
# us by which a reading may seem to come before it was made; further, the device was reset
_SLACK_US = 1_000_000
_WINDOW_NS = 1_000_000_000  # ns over which the least delay is sought, at least one and at most two of them


class DeviceTime:
    """Maps a device's clock (us, wraps at 2^32) to the host's by the reading that was least delayed.

    What arrives is late by the wire, by the USB adapter that collects, by the host that is busy: never
    early. So the smallest difference of arrival and device time within the last one to two seconds is the
    offset of the clocks; two clocks that drift by 100 ppm are 0.2 ms apart by then. One instance per
    handshake: a device that was reset counts anew.

    Attributes:
        period_s: between readings.
        counters: `missing`, readings that never came, by the gaps in the device's time.
    """

    def __init__(self, period_s: float, wire_s: float = 0.0, counters: Counter[str] | None = None) -> None:
        """`wire_s`: what a reading needs on the wire, the least delay that there can be."""
        self.period_s = period_s
        self.counters = Counter[str]() if counters is None else counters
        self._wire_ns = round(wire_s * 1e9)
        self._last_us: int | None = None
        self._device_us = 0
        self._window_ns = 0
        self._least: list[int] = []  # of the window before, and of this one
        self._stamp_ns: int | None = None

    def stamps(self, device_us: Sequence[int], now_ns: int) -> list[int]:
        """Returns the host's stamps in ns of readings that arrived together at `now_ns`, oldest first. They
        never decrease and never lie after `now_ns`; empty for no readings. Updates the offset of the clocks
        and counts `missing` readings. DeviceError: the device's clock jumped, so it was reset.
        """
        unwrapped = [self._unwrapped(t_us, now_ns) for t_us in device_us]
        if not unwrapped:
            return []
        self._learn(now_ns - unwrapped[-1] * 1000, now_ns)
        offset_ns = min(self._least) - self._wire_ns
        return [self._next(offset_ns + t_us * 1000, now_ns) for t_us in unwrapped]

    def _unwrapped(self, t_us: int, now_ns: int) -> int:
        """Returns the device time in us without wraps, and stores it; adds a gap in it to `missing`.
        DeviceError: the clock jumped, by more than 1 s beyond the host's.
        """
        if self._last_us is None:
            self._last_us, self._window_ns, self._device_us = t_us, now_ns, t_us
            return t_us
        step_us = (t_us - self._last_us) % _WRAP_US
        if self._ahead_us(step_us, now_ns) > _SLACK_US:
            raise DeviceError(f"the device's clock jumped from {self._last_us} to {t_us} us: it was reset")
        self.counters["missing"] += max(0, round(step_us * 1e-6 / self.period_s) - 1)
        self._last_us = t_us
        self._device_us += step_us
        return self._device_us

    def _ahead_us(self, step_us: int, now_ns: int) -> int:
        """Time in us by which a reading would come before it was made, by the way of all before it.

        Not by the way of the last one: a host that stood still finds what had come before that, late, and
        right behind it what comes now.
        """
        made_ns = (self._device_us + step_us) * 1000 + min(self._least) if self._least else 0
        return (made_ns - now_ns) // 1000

    def _learn(self, difference_ns: int, now_ns: int) -> None:
        """Updates the least difference of arrival and device time (ns) of this window, and of the one before.
        A window lasts 1 s; the next one begins with this difference.
        """
        if not self._least:
            self._least = [difference_ns, difference_ns]
        elif now_ns - self._window_ns >= _WINDOW_NS:
            self._window_ns, self._least = now_ns, [self._least[1], difference_ns]
        else:
            self._least[1] = min(self._least[1], difference_ns)

    def _next(self, stamp_ns: int, now_ns: int) -> int:
        """The stamp, at least 1 ns after the one before, also where the offset has just become smaller."""
        if self._stamp_ns is not None:
            stamp_ns = max(stamp_ns, self._stamp_ns + 1)
        self._stamp_ns = min(stamp_ns, now_ns)
        return self._stamp_ns
