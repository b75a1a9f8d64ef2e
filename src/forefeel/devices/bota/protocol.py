"""The binary stream of Bota force-torque cells (SensONE, Rokubi on serial). Pure.

A frame is 37 bytes: `AA`; status, forces, torques, the device's microseconds, temperature as `<H6fIf`; the
CRC-16/X-25 of those 34 bytes, little endian.
"""

import struct
from collections import Counter
from math import isfinite
from typing import NamedTuple

BAUD = 460_800  # bit/s, the default of `BotaSettings.baud`
HEADER = 0xAA  # first byte of a frame; it may stand within one, too
# bits of the status word; names and order as in the maker's own drivers for ROS and Arduino (`DataStatus`)
APP_TOOK_TOO_LONG, OVERRANGE, INVALID, RAW = 1, 2, 4, 8
STATUS_BITS = {
    APP_TOOK_TOO_LONG: "app_took_too_long",
    OVERRANGE: "overrange",
    INVALID: "invalid",
    RAW: "raw",
}
"""What makes a measurement none: the cell skips, is beyond its range, is broken, or sends its gauges."""

_BODY = struct.Struct("<H6fIf")
_CRC = struct.Struct("<H")
FRAME_BYTES = 1 + _BODY.size + _CRC.size
_FLAGS = sum(STATUS_BITS)


def _crc_table() -> tuple[int, ...]:
    """Computes the table of CRC-16/X-25: the register after each of the 256 bytes."""
    rows = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
        rows.append(value)
    return tuple(rows)


_X25 = _crc_table()


def crc_x25(data: bytes) -> int:
    """CRC-16/X-25: polynomial 1021 reflected, start and end FFFF; of "123456789" it is 906E."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _X25[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFF


class BotaFrame(NamedTuple):
    """One measurement: forces in N, torques in N m, the device's clock (wraps at 2^32 us), temperature."""

    status: int
    fx_n: float
    fy_n: float
    fz_n: float
    mx_n_m: float
    my_n_m: float
    mz_n_m: float
    t_us: int
    temperature_c: float

    @property
    def finite(self) -> bool:
        return all(map(isfinite, self))

    @property
    def flags(self) -> tuple[str, ...]:
        """The names of the status bits that are set; reserved bits mean nothing."""
        return tuple(name for bit, name in STATUS_BITS.items() if self.status & bit)

    @property
    def valid(self) -> bool:
        """No status bit is set, and every number is finite."""
        return not self.status & _FLAGS and self.finite


def encode(frame: BotaFrame) -> bytes:
    body = _BODY.pack(*frame)
    return bytes([HEADER]) + body + _CRC.pack(crc_x25(body))


class BotaParser:
    """Bytes in, frames out. After a bad checksum one byte is dropped and the search goes on behind it, so a
    frame behind a damaged one is never lost.

    Attributes:
        counters: `frames`, `bad_checksum` (headers that began no frame), `junk_bytes` (all that belonged to
            no frame), `resynchronised` (frames that were found behind junk).
    """

    def __init__(self, counters: Counter[str] | None = None) -> None:
        self.counters = Counter[str]() if counters is None else counters
        self._buffer = bytearray()  # never longer than what was fed and one frame
        self._lost = False

    def feed(self, data: bytes) -> list[BotaFrame]:
        """Returns the frames that are complete now, oldest first; counts and drops anything else."""
        buffer, at = self._buffer, 0
        buffer += data
        frames: list[BotaFrame] = []
        while True:
            header = buffer.find(HEADER, at)
            start = header if header >= 0 else len(buffer)
            self._drop(start - at)
            at = start
            if len(buffer) - at < FRAME_BYTES:
                break
            frame = _decoded(buffer, at)
            if frame is None:
                self.counters["bad_checksum"] += 1
                self._drop(1)
                at += 1
            else:
                frames.append(self._count(frame))
                at += FRAME_BYTES
        del buffer[:at]
        return frames

    def _drop(self, count: int) -> None:
        if count:
            self.counters["junk_bytes"] += count
            self._lost = True

    def _count(self, frame: BotaFrame) -> BotaFrame:
        self.counters["frames"] += 1
        self.counters["resynchronised"] += self._lost
        self._lost = False
        return frame


def _decoded(buffer: bytearray, at: int) -> BotaFrame | None:
    body = bytes(buffer[at + 1 : at + 1 + _BODY.size])
    (crc,) = _CRC.unpack_from(buffer, at + 1 + _BODY.size)
    return BotaFrame._make(_BODY.unpack(body)) if crc == crc_x25(body) else None
