"""Bota six-axis cells on a serial port: one reading per frame, stamped by the cell's own clock."""

from collections import Counter, deque
from math import inf, isfinite
from statistics import median

from forefeel.common.hardware.calibration import LoadCellCalibration
from forefeel.devices.bota.protocol import FRAME_BYTES, BotaFrame, BotaParser
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.shared.device_time import DeviceTime
from forefeel.devices.shared.force_scale import ForceScale, Native, StuckWatch
from forefeel.devices.shared.serial_cell import Cell, SerialLoadCell

_BITS = 10  # start, eight data bits, stop


class BotaSerialLoadCell(SerialLoadCell[BotaSettings]):
    """Load-cell port on a Bota cell in run mode.

    The stamps are those of the cell's frames: the delay of its own filter comes on top.
    """

    def _cell(self) -> Cell:
        return BotaCell(self._settings, self.link.counters)

    def _scale(self, calibration: LoadCellCalibration | None) -> ForceScale:
        s = self._settings
        return ForceScale(
            s.full_scale_n, s.sign, 1.0, calibration, StuckWatch(noisy=True), self.link.counters
        )


class BotaCell(Cell):
    """The protocol of a Bota cell: a measurement is the configured component of a frame, in N."""

    def __init__(self, settings: BotaSettings, counters: Counter[str]) -> None:
        self.expected = f"Bota frames at {settings.baud} baud"
        self._component = BotaFrame._fields.index(f"{settings.component}_n")
        self._parser = BotaParser(counters)
        wire_s = FRAME_BYTES * _BITS / settings.baud
        self._time = DeviceTime(1.0 / settings.rate_hz, wire_s, counters)
        enough = min(max(round(0.1 * settings.rate_hz), 8), 80)
        self.measure_s = 1.0 + 3.0 * enough / settings.rate_hz
        self._steps_us = deque[int](maxlen=enough)
        self._last_us: int | None = None

    @property
    def measured_hz(self) -> float | None:
        """The rate by the cell's clock, from the median step, so that lost frames do not count."""
        if len(self._steps_us) < (self._steps_us.maxlen or 0):
            return None
        step_us = median(self._steps_us)
        return 1e6 / step_us if step_us else inf

    def take(self, data: bytes, now_ns: int) -> list[Native]:
        """Returns the measurements of the frames that are complete now, oldest first, stamped by the cell's
        clock. Notes the steps of that clock for the rate. DeviceError: the clock jumped, so the cell was
        reset.
        """
        frames = self._parser.feed(data)
        if not frames:
            return []
        for frame in frames:
            if self._last_us is not None:
                self._steps_us.append((frame.t_us - self._last_us) % (1 << 32))
            self._last_us = frame.t_us
        stamps = self._time.stamps([frame.t_us for frame in frames], now_ns)
        return [self._native(frame, stamp_ns) for frame, stamp_ns in zip(frames, stamps, strict=True)]

    def _native(self, frame: BotaFrame, stamp_ns: int) -> Native:
        force_n = frame[self._component]
        flaws = () if frame.valid else frame.flags if frame.finite else (*frame.flags, "not_finite")
        return Native(force_n if isfinite(force_n) else 0.0, stamp_ns, flaws)
