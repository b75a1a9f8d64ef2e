"""Serial ports as byte streams.

Whatever pyserial raises (SerialException, a bare OSError, termios.error, which is neither) is a DeviceError
here.
"""

import os
import select
import termios
from contextlib import suppress
from pathlib import Path

import serial
from serial.tools import list_ports

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.devices.shared.settings import SerialSettings

_BROKEN = (serial.SerialException, OSError, termios.error, TypeError, ValueError)
"""The last two: closed while it reads."""
_CHUNK_BYTES = 4096  # bytes of one read
_WRITE_S = 0.5  # s that a write waits for a port that takes no bytes
_USB_SERIAL = Path("/sys/bus/usb-serial/devices")
_USUAL_LATENCY_MS = 1  # ms, the least that an FTDI adapter can be set to; what deploy/udev sets


class SerialStream:
    """A serial port, opened for us alone; once it is gone, `read` and `write` raise DeviceError.

    Attributes:
        timeout_s: how long `read` waits for the first byte; None: for ever.

    Raises:
        DeviceSetupError: no such port, busy, not permitted, or it can not be set up like that.
    """

    def __init__(self, settings: SerialSettings, timeout_s: float = 0.02) -> None:
        self.name = settings.port
        self.timeout_s: float | None = timeout_s
        try:
            self._serial = serial.Serial(settings.port, settings.baud, timeout=timeout_s, exclusive=True)
        except (serial.SerialException, OSError, termios.error, ValueError) as error:
            raise DeviceSetupError(_why_not(settings, error)) from error

    def read(self) -> bytes:
        """Reads up to 4 KiB; waits at most `timeout_s` for the first byte, empty if none came. DeviceError:
        the port is gone, or was closed.
        """
        try:  # past pyserial's read, which takes three times the system calls for a frame each millisecond
            number = self._serial.fileno()
            if not select.select([number], [], [], self.timeout_s)[0]:
                return b""
            data = os.read(number, _CHUNK_BYTES)
        except _BROKEN as error:
            raise DeviceError(f"{self.name}: gone while reading ({_short(error)})") from error
        if not data:
            raise DeviceError(f"{self.name}: gone while reading (ready, but without data)")
        return data

    def write(self, data: bytes) -> None:
        """Writes all bytes. DeviceError: the port takes none for 0.5 s, or is gone."""
        try:  # past pyserial's write, which fails after all is written when the process was frozen meanwhile
            number = self._serial.fileno()
            while data:
                if not select.select([], [number], [], _WRITE_S)[1]:
                    raise DeviceError(f"{self.name}: takes no bytes for {_WRITE_S:g} s")
                data = data[os.write(number, data) :]
        except _BROKEN as error:
            raise DeviceError(f"{self.name}: gone while writing ({_short(error)})") from error

    def close(self) -> None:
        with suppress(*_BROKEN):  # it is gone: as closed as it will be
            self._serial.close()


def latency_warning(port: str, devices: Path = _USB_SERIAL) -> str | None:
    """Returns advice if the latency timer of the port's FTDI adapter, which delays answers, exceeds 1 ms.
    None if it does not, or there is no such timer. `devices`: the folder of sysfs to look in.
    """
    try:
        timer_ms = int((devices / Path(os.path.realpath(port)).name / "latency_timer").read_text())
    except (OSError, ValueError):
        return None
    if timer_ms <= _USUAL_LATENCY_MS:
        return None
    return f"{port}: latency timer {timer_ms} ms, expected 1 (deploy/udev sets it)"


def _why_not(settings: SerialSettings, error: BaseException) -> str:
    """Error text for a port that can not be opened: missing, busy, not permitted, or else."""
    port, text = settings.port, str(error)
    if not Path(port).exists():
        return f"{port}: no such port; expected one that `forefeel devices` lists"
    if "exclusively lock" in text or "Resource temporarily unavailable" in text or "busy" in text.lower():
        return f"{port}: busy, another process holds it; expected it free: `fuser -v {port}` names who"
    if isinstance(error, PermissionError) or "Permission denied" in text:
        group = f"$(stat -c %G {port})"
        return f"{port}: not permitted; type: sudo usermod -aG {group} $USER, then log in again"
    return f"{port}: can not be opened at {settings.baud} baud ({_short(error)}); expected a serial port"


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


def port_serial(port: str) -> str:
    """The serial number of the USB adapter or device behind a port; empty where it has none."""
    device = os.path.realpath(port)
    for adapter in list_ports.comports():
        if adapter.device == device and adapter.serial_number:
            return str(adapter.serial_number)
    return ""
