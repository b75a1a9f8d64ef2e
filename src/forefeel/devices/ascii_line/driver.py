"""Load cells that print a number a line, streaming or asked (Loadstar, HX711 on a microcontroller)."""

from collections import Counter, deque

from forefeel.common.errors import DeviceSetupError
from forefeel.common.hardware.calibration import LoadCellCalibration
from forefeel.devices.ascii_line.protocol import COUNTS_RANGE, NEWTON_PER_UNIT, AsciiReading, LineParser
from forefeel.devices.ascii_line.settings import AsciiLineSettings
from forefeel.devices.shared.force_scale import ForceScale, Native, StuckWatch
from forefeel.devices.shared.serial_cell import Cell, SerialLoadCell

_BITS = 10  # start, eight data bits, stop
_QUIET_NS = 100_000_000  # ns after a carriage return before the first request
_LEAST_ANSWER_NS = 40_000_000  # ns, least time that a cell has for its answer
_RETURN = b"\r"


class AsciiLineLoadCell(SerialLoadCell[AsciiLineSettings]):
    """Load-cell port on a cell of numbers.

    It has neither clock nor checksum: a reading is stamped when its line began to arrive, a digit that the
    wire changed is believed where it stays below the full scale, and of a stream a whole line that is lost
    is not missed (an answer is: `unanswered`).
    """

    def _cell(self) -> Cell:
        return AsciiCell(self._settings, self.link.counters)

    def _scale(self, calibration: LoadCellCalibration | None) -> ForceScale:
        """Makes the force scale of the cell's unit, or of the calibration if there is one. DeviceSetupError:
        counts without a calibration, unless opened for native readings.
        """
        s = self._settings
        if s.unit == "counts" and calibration is None and not self._native:
            raise DeviceSetupError(
                f"{self.link.name}: unit = 'counts' without calibration; expected a file of "
                "`forefeel calibrate load-cell`"
            )
        watch = StuckWatch(noisy=False)
        unit_n = NEWTON_PER_UNIT.get(s.unit)
        return ForceScale(s.full_scale_n, s.sign, unit_n, calibration, watch, self.link.counters)


class AsciiCell(Cell):
    """The protocol of a cell that prints a number a line.

    Where the settings have a request, a carriage return first ends a stream that may still run; then the cell
    is asked once a period.
    """

    def __init__(self, settings: AsciiLineSettings, counters: Counter[str]) -> None:
        self._request, asked = b"", ""
        if settings.request is not None:
            self._request = settings.request.encode("ascii", "replace") + _RETURN
            asked = f", asked by {settings.request!r},"
            self.settle_s, self.wait_s = _QUIET_NS * 1e-9, min(0.02, 0.25 / settings.rate_hz)
        self.expected = f"lines of numbers{asked} at {settings.baud} baud"
        self._ends = COUNTS_RANGE if settings.unit == "counts" else ()
        self.counters = counters
        self._parser = LineParser(settings.unit, counters)
        self._byte_ns = _BITS * 1e9 / settings.baud
        self._period_ns = round(1e9 / settings.rate_hz)
        enough = max(8, round(0.5 * settings.rate_hz))
        self.measure_s = 1.0 + 5.0 * enough / settings.rate_hz
        self._arrived = deque[int](maxlen=enough + 1)
        self._stamp_ns: int | None = None
        self._quiet_ns: int | None = None
        self._asked_ns: int | None = None
        self._outstanding = False

    @property
    def measured_hz(self) -> float | None:
        """The rate by the host's clock, over half a second, but at least eight readings. None while there are
        not so many, and when they all came at once, for the host was busy.
        """
        if len(self._arrived) < (self._arrived.maxlen or 0):
            return None
        span_ns = self._arrived[-1] - self._arrived[0]
        return None if span_ns < self._period_ns else (len(self._arrived) - 1) * 1e9 / span_ns

    # --- asking ---

    def due(self, now_ns: int) -> bytes:
        """Returns the bytes to send now: the request once a period, none in between, never any to a cell that
        streams by itself. The first call returns a carriage return, and the requests begin 0.1 s later. After
        one without an answer it waits two periods, at least 40 ms, and counts it as `unanswered`.
        """
        if not self._request:
            return b""
        if self._quiet_ns is None:
            self._quiet_ns = now_ns + _QUIET_NS
            return _RETURN
        if self._asked_ns is None:
            if now_ns < self._quiet_ns:
                return b""
            self._parser.begin()
            self._asked_ns = now_ns
        else:
            since_ns, twice_ns = now_ns - self._asked_ns, 2 * self._period_ns
            if since_ns < (max(twice_ns, _LEAST_ANSWER_NS) if self._outstanding else self._period_ns):
                return b""
            self._asked_ns = now_ns if since_ns >= twice_ns else self._asked_ns + self._period_ns
        self.counters["unanswered"] += self._outstanding
        self._outstanding = True
        return self._request

    # --- hearing ---

    def take(self, data: bytes, now_ns: int) -> list[Native]:
        """Returns the measurements of the lines that are complete now, oldest first, several at once stamped
        a period apart. Any of them answers the request that is open. Where the cell is sent requests, bytes
        before the first one are dropped.
        """
        if self._request and self._asked_ns is None:
            return []  # a stream that has not ended yet
        lines = self._parser.feed(data)
        if lines:
            self._outstanding = False
        return [
            self._native(line, now_ns - (len(lines) - 1 - at) * self._period_ns, now_ns)
            for at, line in enumerate(lines)
        ]

    def _native(self, line: AsciiReading, arrived_ns: int, now_ns: int) -> Native:
        """Returns the measurement of a line, stamped when it began to arrive: `arrived_ns` less its time on
        the wire, but later than the last stamp and at most `now_ns`. Counts at an end of the range have
        the flaw `overrange`. Notes `now_ns` for the rate.
        """
        self._arrived.append(now_ns)
        stamp_ns = arrived_ns - round(line.size * self._byte_ns)
        if self._stamp_ns is not None:
            stamp_ns = min(max(stamp_ns, self._stamp_ns + 1), now_ns)
        self._stamp_ns = stamp_ns
        return Native(line.number, stamp_ns, ("overrange",) if line.number in self._ends else ())
