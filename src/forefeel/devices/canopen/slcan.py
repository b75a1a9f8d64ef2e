"""Serial CAN adapters (LAWICEL, "slcan"): python-can's bus, made to survive whatever an adapter sends.

`tIIILDD..` is a frame with an 11-bit identifier, `T` with 29 bits, `r` and `R` remote frames; a carriage
return ends a line, a bell is a refusal. The protocol has no checksum: a digit that became another digit is
a valid frame.
"""

import re
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

import can
from can.exceptions import error_check
from can.interfaces.slcan import slcanBus

from forefeel.common.errors import DeviceSetupError
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.shared.stream import SerialStream

OK, BELL = b"\r", b"\x07"
BITRATES = slcanBus._BITRATES
_LONGEST = 64  # of a line: T, 8 digits, length, 16 digits, 4 of a time stamp are 30
_STAMP_DIGITS = 4  # hexadecimal digits of the time stamp, in ms, that an adapter may append (LAWICEL)
_FRAME = re.compile(rb"(?:[tr][0-7]H{2}|[TR][01]H{7})([0-8])(H*)".replace(b"H", b"[0-9A-Fa-f]"))


def frame_of(line: bytes) -> bytes | None:
    """Returns the frame that a line ends with, without its time stamp; None unless it is whole and valid.

    What stands before it, such as a truncated frame, is ignored: its letter can not be a digit of another.
    """
    start = max(0, *(line.rfind(letter) for letter in b"trTR"))
    match = _FRAME.fullmatch(line, start)
    if match is None:
        return None
    digits = 0 if line[start] in b"rR" else 2 * int(match[1])
    whole = len(match[2]) in (digits, digits + _STAMP_DIGITS)
    return line[start : match.start(2) + digits] if whole else None


class Lines:
    """Cuts bytes into lines; bounded.

    Attributes:
        counts: `bells`, and `overlong` lines, which are dropped as a whole.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """Returns the lines that are complete now, in order, none of them empty. A bell ends a line, too, and
        is counted. An incomplete line of more than 64 bytes is dropped and counted.
        """
        self.counts["bells"] += data.count(BELL)
        *complete, self._rest = (self._rest + data).replace(BELL, OK).split(OK)
        if complete and self._skipping:
            complete, self._skipping = complete[1:], False
        if len(self._rest) > _LONGEST:
            self.counts["overlong"] += not self._skipping
            self._rest, self._skipping = b"", True
        return [line for line in complete if line]


class _Port(SerialStream):
    write_timeout: float | None = None  # python-can sets it


class SlcanBus(slcanBus):
    """A serial CAN adapter, opened for us alone.

    python-can 4.6.1 ends at a damaged digit (its issue 1821), keeps a byte that is not ASCII for ever, does
    not compare length and data, shares the port with other processes and flushes it after every frame.

    Args:
        channel: the serial port, with `@baud` where the adapter needs another than 115200.
        bitrate: of the bus, one of `BITRATES`.

    Attributes:
        counts: `damaged` lines, `bells`, `overlong` lines.

    Raises:
        DeviceSetupError: the port can not be used, or the adapter has no such bitrate.
    """

    def __init__(
        self,
        channel: str,
        bitrate: int = 1_000_000,
        open_port: Callable[[SerialSettings, float], Any] = _Port,
    ) -> None:
        port, _, baud = channel.partition("@")
        if bitrate not in BITRATES:
            known = ", ".join(map(str, BITRATES))
            raise DeviceSetupError(f"{channel}: bitrate = {bitrate}: expected one of {known}")
        if baud and not baud.isdecimal():
            raise DeviceSetupError(f"{channel}: expected a port, or port@baud")
        self.serialPortOrig = open_port(SerialSettings(port=port, baud=int(baud or 115_200)), 0.0)
        self._queue, self._listen_only = SimpleQueue[str](), False
        self._lines, self._frames = Lines(), deque[str]()
        self.counts = self._lines.counts
        self._can_protocol = can.CanProtocol.CAN_20
        can.BusABC.__init__(self, channel)  # slcanBus would open the port once more
        self._write("")
        self.set_bitrate(bitrate)

    def _read(self, timeout: float | None) -> str | None:
        """Returns the oldest frame as a line of slcan; None when none comes in time. Counts damaged lines."""
        if not self._frames:
            self.serialPortOrig.timeout_s = timeout
            with error_check():
                lines = self._lines.feed(self.serialPortOrig.read())
            for line in lines:
                frame = frame_of(line)
                if frame is not None:
                    self._frames.append(frame.decode("ascii"))
                if frame is None or not line.startswith(frame):
                    self.counts["damaged"] += line[:1] not in b"zZVNFv"
        return self._frames.popleft() if self._frames else None

    def _write(self, string: str) -> None:
        with error_check():
            self.serialPortOrig.write(string.encode("ascii") + OK)

    def shutdown(self) -> None:
        """Leaves the bus and closes the port; idempotent, silent when the adapter is gone."""
        with suppress(can.CanOperationError):
            super().shutdown()
        self.serialPortOrig.close()
