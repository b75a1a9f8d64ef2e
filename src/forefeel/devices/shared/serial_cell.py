"""Load cells on a serial port: handshake, the thread that reads, silence, faults, re-arming."""

from datetime import date
from typing import Generic, TypeVar

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError, DeviceSetupError, InputError
from forefeel.common.events.text import quantity
from forefeel.common.hardware.calibration import LoadCellCalibration, load_cell_calibration
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.shared.conversation import Conversation, Steps
from forefeel.devices.shared.force_scale import ForceScale, Native
from forefeel.devices.shared.load_cell import QueuedLoadCell
from forefeel.devices.shared.settings import SerialCellSettings
from forefeel.devices.shared.stream import SerialStream, port_serial

S = TypeVar("S", bound=SerialCellSettings)

_IDENTIFY_S = 1.0  # s for the first reading, beyond what the cell says of itself and two periods
_RATE_TOLERANCE = 0.1  # share by which the measured rate may differ from `rate_hz`
# s of silence that are a fault where five periods are shorter (docs/decisions/0014)
_LEAST_SILENCE_S = 0.05


class Cell:
    """Protocol of a cell from one handshake to the next: bytes in, measurements out. No I/O.

    Attributes:
        expected: what should come, with its baud: `Bota frames at 460800 baud`.
        wait_s: how long to wait for bytes at most, before it may have something to send.
        settle_s: how long it needs until its first measurement, beyond the usual.
        measure_s: how long measuring its rate may take.
    """

    expected: str
    measure_s: float
    wait_s, settle_s = 0.02, 0.0

    @property
    def measured_hz(self) -> float | None:
        """Its rate; None until there are enough measurements."""
        raise NotImplementedError

    def due(self, now_ns: int) -> bytes:
        """Bytes to send now."""
        del now_ns
        return b""

    def take(self, data: bytes, now_ns: int) -> list[Native]:
        """The measurements in the bytes that came, oldest first; DeviceError: the cell was reset."""
        raise NotImplementedError


class SerialLoadCell(QueuedLoadCell, Generic[S]):
    """Load-cell port on a serial port; the subclasses know what the bytes mean.

    Attributes:
        link: its state, identity, counters, and serial: of the USB adapter, else as the
            settings have it.
        stale_s: three periods and 20 ms.
        measured_hz: the rate that the last handshake found.
        calibration: as it was loaded; None: there is none.
        scale: by the data sheet.
    """

    def __init__(self, settings: S, clock: Clock | None = None) -> None:
        link = DeviceLink(f"load cell {settings.driver} on {settings.port}")
        super().__init__(link, settings.full_scale_n, 3.0 / settings.rate_hz + 0.02)
        self.measured_hz: float | None = None
        self._settings: S = settings
        self.scale = settings.scale
        self._clock = clock or MonotonicClock()
        self._silence_ns = round(max(5.0 / settings.rate_hz, _LEAST_SILENCE_S) * 1e9)

    # --- what the subclasses know ---

    def _cell(self) -> Cell:
        raise NotImplementedError

    def _scale(self, calibration: LoadCellCalibration | None) -> ForceScale:
        raise NotImplementedError

    def _open_s(self) -> float:
        cell = self._cell()
        return _identify_s(cell, self._settings.rate_hz) + cell.measure_s + 3.0

    # --- the conversation, in its own thread ---

    def _converse(self, conversation: Conversation) -> Steps:
        """Opens the port, identifies the cell, checks its rate, and reads until the conversation ends."""
        cell = self._cell()
        stream = SerialStream(self._settings, cell.wait_s)
        try:
            self.link.advance(LinkState.OPEN)
            self._force = self._calibrated()
            yield from self._identify(conversation, stream, cell)
            yield from self._measure_rate(conversation, stream, cell)
            yield from self._exchange(conversation, stream, cell)
        finally:
            stream.close()

    def _calibrated(self) -> ForceScale:
        """Stores the serial number in the link, loads the calibration if the settings name one, returns the
        scale. With `open_native` no calibration is loaded. DeviceError: another serial number than before.
        DeviceSetupError: a calibration, but no serial number, or one that does not fit the device or
        settings.
        """
        serial, path = self._serial(), self._settings.calibration
        if self.link.serial not in ("", serial):
            raise DeviceError(
                f"{self.link.name}: another device, serial {serial}; expected {self.link.serial}"
            )
        self.link.serial = serial
        if self._native:
            return self._scale(None)
        if path and not serial:
            raise DeviceSetupError(
                f"{self.link.name}: a calibration, but the port has no serial number to check it by; "
                "expected load_cell.serial, the number on the device's label"
            )
        try:
            about = self._settings.driver, serial, date.today(), self._settings.scale
            self.calibration = load_cell_calibration(path, *about) if path else None
        except InputError as error:
            raise DeviceSetupError(str(error)) from error
        return self._scale(self.calibration)

    def _serial(self) -> str:
        """Returns the serial number of the port, else that of the settings, else an empty text.
        DeviceSetupError: both have one, and they differ.
        """
        attached, given = port_serial(self._settings.port), self._settings.serial
        if attached and given not in (None, attached):
            raise DeviceSetupError(
                f"{self.link.name}: serial = {given!r}: expected {attached!r}, the port's own, or none"
            )
        return attached or given or ""

    def _identify(self, conversation: Conversation, stream: SerialStream, cell: Cell) -> Steps:
        """Reads until the first measurement, then sets the link's identity and advances it to IDENTIFIED.
        Ends early when the conversation is stopping. DeviceSetupError: no measurement comes in time.
        """
        start_ns, came = self._clock.now_ns(), 0
        patience_s = _identify_s(cell, self._settings.rate_hz)
        while self.link.state < LinkState.IDENTIFIED and not conversation.stopping:
            data = self._transfer(stream, cell)
            now_ns = self._clock.now_ns()
            came += len(data)
            if cell.take(data, now_ns):
                self.link.identity = f"{self._settings.driver}, serial {self.link.serial or 'unknown'}"
                self.link.advance(LinkState.IDENTIFIED)
            elif now_ns - start_ns > patience_s * 1e9:
                raise DeviceSetupError(self._unidentified(came, patience_s, cell))
            yield 0.0

    def _measure_rate(self, conversation: Conversation, stream: SerialStream, cell: Cell) -> Steps:
        """Reads until the measured rate is within 10 % of `rate_hz`, then advances the link to READY. Sets
        `measured_hz`; ends early when the conversation is stopping. DeviceSetupError: not in time.
        """
        start_ns, rate_hz = self._clock.now_ns(), self._settings.rate_hz
        while not conversation.stopping:
            cell.take(self._transfer(stream, cell), self._clock.now_ns())
            measured_hz = self.measured_hz = cell.measured_hz
            if measured_hz is not None and abs(measured_hz - rate_hz) <= _RATE_TOLERANCE * rate_hz:
                self.link.advance(LinkState.CONFIGURED)
                self.link.advance(LinkState.READY)
                return
            if self._clock.now_ns() - start_ns > cell.measure_s * 1e9:
                measured = "too few to tell" if measured_hz is None else f"{measured_hz:.4g} Hz measured"
                raise DeviceSetupError(
                    f"{self._settings.port}: rate_hz = {rate_hz:g}: {measured}; "
                    "expected the rate that the cell is set to, within 10 %"
                )
            yield 0.0

    def _exchange(self, conversation: Conversation, stream: SerialStream, cell: Cell) -> Steps:
        """Checks and queues every measurement (`_measured`) until the conversation ends. DeviceError: no
        measurement for five periods, or 50 ms if that is longer.
        """
        last_ns, since = self._clock.now_ns(), 0
        while not conversation.stopping:
            silent_ns = self._clock.now_ns() - last_ns  # before reading: a host that was busy gets bytes
            data = self._transfer(stream, cell)
            now_ns = self._clock.now_ns()
            measurements = cell.take(data, now_ns)
            since += len(data)
            if measurements:
                last_ns, since = now_ns, 0
            elif silent_ns > self._silence_ns:
                what = f"{since} bytes, but none of the {cell.expected}" if since else "nothing"
                raise DeviceError(f"{self.link.name}: {what} for {quantity(silent_ns * 1e-9, 's')}")
            for native in measurements:
                self._measured(native)
            yield 0.0

    def _transfer(self, stream: SerialStream, cell: Cell) -> bytes:
        request = cell.due(self._clock.now_ns())
        if request:
            stream.write(request)
        return stream.read()

    def _unidentified(self, came: int, patience_s: float, cell: Cell) -> str:
        """Returns the error text for an unidentified cell: nothing came, or `came` bytes of no meaning."""
        where, expected = self._settings.port, cell.expected
        if not came:
            what = f"nothing comes within {patience_s:.2g} s"
            return f"{where}: {what}; expected {expected}: no power, or another device"
        return (
            f"{where}: {came} bytes within {patience_s:.2g} s, but nothing of the expected {expected}: "
            "wrong baud or another device"
        )


def _identify_s(cell: Cell, rate_hz: float) -> float:
    return _IDENTIFY_S + cell.settle_s + 2.0 / rate_hz
