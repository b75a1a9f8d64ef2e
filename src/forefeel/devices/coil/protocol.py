"""The link to a master handle's microcontroller: frames and their parser. Pure.

A frame is `00 COBS(kind u8, body, CRC-16/CCITT-FALSE u16) 00`, little-endian. The delimiter stands on both
sides, so that a byte that is wrong anywhere, a delimiter included, costs one frame and no other.

The device sends states at the rate that its identity says, once it has been identified; each is answered by
a command. firmware/ has the frames on a page, and the firmware of a reference handle.
"""

import binascii
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from enum import IntEnum, IntFlag
from typing import NamedTuple

from cobs import cobs

from forefeel.common.messages import SafetyState

PROTOCOL = 2  # version of this protocol; a device of another one is refused
NAME = "forefeel-coil"
MAX_BUFFER = 512  # bytes without a delimiter that are stored: no frame is as long

_CRC = struct.Struct("<H")
_STATE = struct.Struct("<HIiiBBh")
_COMMAND = struct.Struct("<HhBiB")
COMMAND_BYTES = _COMMAND.size + 6  # on the wire: two delimiters, COBS, kind, CRC
_IDENTIFY = struct.Struct("<BHH")
_IDENTITY = struct.Struct("<BHHHHI")
_MOST_TEXT_BYTES = 32  # bytes of a text in an identity
_MOST_I16, _MOST_I32 = 2**15 - 1, 2**31 - 1  # largest of i16 and i32
_MOST_U16, _MOST_U32 = 2**16 - 1, 2**32 - 1
_NO_POSITION_UM = -(2**31)  # `stage_um` of an unknown position: a position is clamped to +-(2**31 - 1)

_LAMPS: tuple[SafetyState | None, ...] = (
    None,
    SafetyState.IDLE,
    SafetyState.READY,
    SafetyState.ENGAGING,
    SafetyState.ARMED,
    SafetyState.STOPPING,
    SafetyState.FAULT,
    SafetyState.ESTOPPED,
)
"""What the lamp shows, by its number on the wire; the first is dark."""


class _Kind(IntEnum):
    STATE = 1
    COMMAND = 2
    IDENTIFY = 3
    IDENTITY = 4


class Button(IntFlag):
    DEADMAN = 1
    GRIPPER = 2
    ESTOP = 4


class Flag(IntFlag):
    """Faults of the device; each but NOT_HOMED takes the current away until the next `Identify`."""

    WATCHDOG = 1
    OVER_TEMPERATURE = 2
    OVERCURRENT = 4
    NOT_HOMED = 8


_BUTTONS, _FLAGS = tuple(map(Button, range(256))), tuple(map(Flag, range(256)))


class CoilState(NamedTuple):
    """Measurements of the device. `sequence` u16 and `time_us` u32 wrap; `velocity`: counts/s."""

    sequence: int
    time_us: int
    counts: int
    velocity: int
    buttons: Button
    flags: Flag
    current_ma: int


class CoilCommand(NamedTuple):
    """Command to the device: current, whether the coil may have any, and what the person is shown."""

    sequence: int
    current_ma: int
    lamp: SafetyState | None
    stage_um: int | None
    enabled: bool


class Identify(NamedTuple):
    """Request of the identity. Clears the device's flags; sets its watchdog and its current limit."""

    protocol: int
    watchdog_ms: int
    limit_ma: int


class CoilIdentity(NamedTuple):
    """Answer to `Identify`; `watchdog_ms`, `limit_ma`: as the device has set them.

    `period_us`: between two states; `late_us`: the longest time from a command's arrival to its current;
    `counts_per_m`: 0 where the device does not know it.
    """

    protocol: int
    watchdog_ms: int
    limit_ma: int
    period_us: int
    late_us: int
    counts_per_m: int
    name: str
    serial: str
    firmware: str


Frame = CoilState | CoilCommand | Identify | CoilIdentity


def encode(frame: Frame) -> bytes:
    """Encodes a frame for the wire; clamps numbers that do not fit, but wraps sequence and time; cuts texts
    to 32 characters.
    """
    match frame:
        case CoilState():
            sequence, time_us = frame.sequence & _MOST_U16, frame.time_us & _MOST_U32
            counts, velocity = _clamped(frame.counts, _MOST_I32), _clamped(frame.velocity, _MOST_I32)
            current_ma = _clamped(frame.current_ma, _MOST_I16)
            body = _STATE.pack(
                sequence, time_us, counts, velocity, frame.buttons & 0xFF, frame.flags & 0xFF, current_ma
            )
            kind = _Kind.STATE
        case CoilCommand():
            stage_um = _NO_POSITION_UM if frame.stage_um is None else _clamped(frame.stage_um, _MOST_I32)
            lamp, current_ma = _LAMPS.index(frame.lamp), _clamped(frame.current_ma, _MOST_I16)
            body = _COMMAND.pack(frame.sequence & _MOST_U16, current_ma, lamp, stage_um, frame.enabled)
            kind = _Kind.COMMAND
        case Identify():
            body, kind = _IDENTIFY.pack(*_unsigned(frame[:3])), _Kind.IDENTIFY
        case CoilIdentity():
            names = frame.name, frame.serial, frame.firmware
            texts = [name.encode("ascii", "replace")[:_MOST_TEXT_BYTES] for name in names]
            body = _IDENTITY.pack(*_unsigned(frame[:5]), min(frame.counts_per_m, _MOST_U32))
            body += b"".join(bytes([len(text)]) + text for text in texts)
            kind = _Kind.IDENTITY
    payload = bytes([kind]) + body
    stuffed: bytes = cobs.encode(payload + _CRC.pack(crc_ccitt_false(payload)))
    return b"\0" + stuffed + b"\0"


def crc_ccitt_false(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 1021, start FFFF; of "123456789" it is 29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


class CoilParser:
    """Bytes in, frames out. Never raises, whatever comes; the next delimiter begins anew.

    What it drops is counted: `bad_framing` (no COBS), `bad_checksum`, `unknown_frame` (checksum right, but
    no frame of ours), `oversized` (no delimiter within 512 bytes).
    """

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        self._buffer = bytearray()
        self._skipping = False

    def feed(self, data: bytes) -> list[Frame]:
        """Returns the frames that are complete now, oldest first; anything else is counted and dropped."""
        *pieces, rest = (bytes(self._buffer) + data).split(b"\0")
        if pieces and self._skipping:
            self._skipping = False
            del pieces[0]
        frames = [frame for piece in pieces if piece and (frame := self._decode(piece)) is not None]
        if len(rest) > MAX_BUFFER:
            self._counters["oversized"] += not self._skipping
            self._skipping, rest = True, b""
        self._buffer = bytearray(b"" if self._skipping else rest)
        return frames

    def _decode(self, piece: bytes) -> Frame | None:
        """Decodes the bytes between two delimiters to a frame; None, counted, if damaged or unknown."""
        if len(piece) > MAX_BUFFER:
            self._counters["oversized"] += 1
            return None
        try:
            payload = cobs.decode(piece)
        except cobs.DecodeError:
            self._counters["bad_framing"] += 1
            return None
        content = payload[: -_CRC.size]
        if not content or _CRC.unpack(payload[-_CRC.size :])[0] != crc_ccitt_false(content):
            self._counters["bad_checksum"] += 1
            return None
        frame = _frame(content[0], content[1:])
        if frame is None:
            self._counters["unknown_frame"] += 1
        return frame


def _frame(kind: int, body: bytes) -> Frame | None:
    decode = _DECODERS.get(kind)
    try:
        return None if decode is None else decode(body)
    except (struct.error, ValueError, IndexError):
        return None


def _state(body: bytes) -> CoilState:
    sequence, time_us, counts, velocity, buttons, flags, current_ma = _STATE.unpack(body)
    return CoilState(sequence, time_us, counts, velocity, _BUTTONS[buttons], _FLAGS[flags], current_ma)


def _command(body: bytes) -> CoilCommand:
    sequence, current_ma, lamp, stage_um, enabled = _COMMAND.unpack(body)
    where = None if stage_um == _NO_POSITION_UM else stage_um
    return CoilCommand(sequence, current_ma, _LAMPS[lamp], where, bool(enabled))


def _identity(body: bytes) -> CoilIdentity:
    """Decodes an identity; ValueError, IndexError: lengths that are not the body's."""
    texts, at = [], _IDENTITY.size
    for _ in range(3):
        end = at + 1 + body[at]
        texts.append(body[at + 1 : end].decode("ascii"))
        at = end
    if at != len(body):
        raise ValueError("a length that is not the body's")
    return CoilIdentity(*_IDENTITY.unpack_from(body), *texts)


_DECODERS: dict[int, Callable[[bytes], Frame]] = {
    _Kind.STATE: _state,
    _Kind.COMMAND: _command,
    _Kind.IDENTIFY: lambda body: Identify(*_IDENTIFY.unpack(body)),
    _Kind.IDENTITY: _identity,
}


def _unsigned(numbers: Sequence[int]) -> list[int]:
    """Version of the protocol and numbers of u16 behind it, clamped."""
    return [numbers[0] & 0xFF, *(min(number, _MOST_U16) for number in numbers[1:])]


def _clamped(value: int, largest: int) -> int:
    return max(-largest, min(largest, value))
