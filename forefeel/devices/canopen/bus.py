"""CAN buses as python-can knows them, and our own for serial adapters.

python-can's slcan dies of one bad character (its issue 1821), is poisoned for ever by one that is not ASCII,
does not check lengths, takes a port that another process uses, and waits for the wire at every frame.
"""

import logging
import select
from collections import deque
from contextlib import ExitStack, suppress
from typing import Any

import can

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.canopen.slcan import BITRATES, Frame, SlcanParser, encoded
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.shared.stream import SerialStream

_USUAL_BAUD = 115_200  # ignored by USB adapters; `/dev/ttyUSB0@3000000` names another
for _name in ("can", "canopen"):  # what they log reaches the user as an error of ours, in one line
    logging.getLogger(_name).addHandler(logging.NullHandler())


class SlcanBus(can.BusABC):
    """A serial CAN adapter, opened for us alone; survives every byte that it sends.

    Args:
        channel: the serial port, with `@baud` where the adapter needs another than 115200.
        bitrate: of the bus, one of `slcan.BITRATES`.
        sleep_after_open: s to wait first, for adapters that restart when the port is opened.

    Raises:
        DeviceSetupError: the port can not be used, or the adapter has no such bitrate.
    """

    def __init__(self, channel: str, bitrate: int = 1_000_000, sleep_after_open: float = 0.0) -> None:
        if bitrate not in BITRATES:
            known = ", ".join(str(each) for each in BITRATES)
            raise DeviceSetupError(f"{channel}: bitrate = {bitrate}: expected one of {known}")
        port, _, baud = channel.partition("@")
        if baud and not baud.isdecimal():
            raise DeviceSetupError(f"{channel}: expected a port, or port@baud")
        settings = SerialSettings(port=port, baud=int(baud) if baud else _USUAL_BAUD)
        self._stream = SerialStream(settings, timeout_s=0.0)
        self.parser = SlcanParser()
        self._frames: deque[Frame] = deque()
        self.channel_info = f"slcan on {channel}"
        if sleep_after_open:
            select.select([], [], [], sleep_after_open)
        super().__init__(channel)
        self._can_protocol = can.CanProtocol.CAN_20
        self._write(f"\rC\r{BITRATES[bitrate]}\rO\r".encode("ascii"))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._frames:
            try:
                ready = select.select([self._stream.fileno()], [], [], timeout)[0]
                self._frames.extend(self.parser.feed(self._stream.read()) if ready else ())
            except (DeviceError, OSError, ValueError) as error:
                raise can.CanOperationError(str(error)) from error
        return (_message(self._frames.popleft()), False) if self._frames else (None, False)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a classic frame; waits no longer than the port's write timeout."""
        del timeout
        data = b"" if msg.is_remote_frame else bytes(msg.data)
        self._write(
            encoded(Frame(msg.arbitration_id, data, msg.is_extended_id, msg.is_remote_frame, msg.dlc))
        )

    def fileno(self) -> int:
        """For select; several frames may come with one event."""
        return self._stream.fileno()

    def shutdown(self) -> None:
        """Leaves the bus and closes the port; idempotent, silent when the adapter is gone."""
        super().shutdown()
        with suppress(can.CanOperationError):
            self._write(b"C\r")
        self._stream.close()

    def _write(self, data: bytes) -> None:
        try:
            self._stream.write(data)
        except DeviceError as error:
            raise can.CanOperationError(str(error)) from error


def _message(frame: Frame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.length if frame.remote else len(frame.data),
    )


def open_bus(settings: CanSettings) -> can.BusABC:
    """The bus that the settings name.

    Raises:
        DeviceSetupError: it can not be opened; one line.
    """
    where = f"{settings.interface} {settings.channel}"
    try:
        if settings.interface == "slcan":
            return SlcanBus(settings.channel, settings.bitrate)
        return can.Bus(interface=settings.interface, channel=settings.channel, **_options(settings))
    except DeviceError:
        raise
    except (can.CanError, OSError, ValueError, ImportError, TypeError) as error:
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise DeviceSetupError(
            f"{where}: can not be opened ({why}); expected a CAN bus that is up, see `forefeel devices`"
        ) from error


def _options(settings: CanSettings) -> dict[str, Any]:
    """Linux sets the bitrate of socketcan; the others have none."""
    if settings.interface == "udp_multicast":
        return {"fd": False, **({"port": settings.port} if settings.port else {})}
    return {}


def open_until(leave: ExitStack, settings: CanSettings) -> can.BusABC:
    """The bus, shut down when `leave` is closed."""
    bus = open_bus(settings)
    leave.callback(bus.shutdown)
    return bus
