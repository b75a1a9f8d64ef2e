"""The baud rate that a host has set on a pseudo terminal, and what is heard at another than was spoken.

A pseudo terminal carries every byte at any rate; a real line does not.
"""

import fcntl
import struct
from contextlib import suppress

_TCGETS2, _TCSETS2 = 0x802C_542A, 0x402C_542B  # of x86 and Arm
_SIZE, _CFLAG, _SPEEDS = 44, 8, 36
_CBAUD, _BOTHER = 0o010_017, 0o010_000
_TOLERANCE = 0.03  # a UART loses its place after half a bit in ten


def host_baud(terminal: int) -> int | None:
    """The rate at which the host sends on an open terminal; None where the system does not tell."""
    state = _state(terminal)
    return None if state is None else struct.unpack_from("<II", state, _SPEEDS)[1]


def set_baud(terminal: int, baud: int) -> None:
    """As a host that opens the port at that rate; nothing where the system has other calls for it."""
    state = _state(terminal)
    if state is None:
        return
    (flags,) = struct.unpack_from("<I", state, _CFLAG)
    struct.pack_into("<I", state, _CFLAG, (flags & ~_CBAUD) | _BOTHER)
    struct.pack_into("<II", state, _SPEEDS, baud, baud)
    with suppress(OSError):
        fcntl.ioctl(terminal, _TCSETS2, bytes(state))


def misheard(data: bytes, spoken_baud: int, heard_baud: int) -> bytes:
    """What a UART at one rate makes of bytes (8N1, no pause between them) at another. Pure.

    A byte whose stop bit is missing is read as 0, as Linux does.
    """
    if abs(heard_baud - spoken_baud) <= _TOLERANCE * spoken_baud:
        return data
    bits = [level for byte in data for level in (0, *(byte >> i & 1 for i in range(8)), 1)]
    ratio, found, at = spoken_baud / heard_baud, bytearray(), 0

    def level(time: float) -> int:
        return bits[int(time)] if time < len(bits) else 1

    while (start := _falling_edge(bits, at)) is not None:
        samples = [level(start + (k + 0.5) * ratio) for k in range(10)]
        at = int(start + 9.5 * ratio) + 1
        if samples[0]:
            at = start + 1  # too short to be a start bit
        else:
            found.append(sum(bit << i for i, bit in enumerate(samples[1:9])) if samples[9] else 0)
    return bytes(found)


def _falling_edge(bits: list[int], at: int) -> int | None:
    """Where the line next falls; it is high before the first bit."""
    falls = (i for i in range(at, len(bits)) if not bits[i] and (i == 0 or bits[i - 1]))
    return next(falls, None)


def _state(terminal: int) -> bytearray | None:
    state = bytearray(_SIZE)
    try:
        fcntl.ioctl(terminal, _TCGETS2, state)
    except OSError:
        return None
    return state
