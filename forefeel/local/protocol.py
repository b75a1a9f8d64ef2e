"""What is said over a daemon's local socket: a datagram of JSON each way."""

import os
import socket
import struct
from pathlib import Path
from typing import Literal, NamedTuple

# bytes of a request: two texts of the longest, each character escaped in 12 bytes, take 6144
LONGEST_DATAGRAM = 8192
LONGEST_TEXT = 256  # characters of a text, as `messages.ShortText`
_CREDENTIALS = struct.Struct("3i")
"""struct ucred of unix(7): process, user, group."""
_NOBODY = 65534  # user id `nobody`, which the kernel gives for unknown ones (/proc/sys/kernel/overflowuid)


class Request(NamedTuple):
    """`axis`: of a clearing; None: all. No text is longer than `LONGEST_TEXT`."""

    do: Literal["state", "estop", "clear"]
    reason: str = ""
    axis: str | None = None


class Answer(NamedTuple):
    """`done`: whether what was asked for is so now; `text`: in words, a line for each thing."""

    done: bool
    text: tuple[str, ...]
    role: str


def socket_path(folder: Path, name: str) -> tuple[int, str]:
    """A descriptor of the folder, to be closed, and a path through it that is short whatever the folder."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    return descriptor, f"/proc/self/fd/{descriptor}/{name}"


def received(bound: socket.socket) -> tuple[bytes, int, str | bytes]:
    """A datagram, cut off behind the longest there is; the user who sent it, as the kernel knows it; where
    the answer goes.

    Raises:
        BlockingIOError: there is none.
    """
    data, ancillary, _, asker = bound.recvmsg(LONGEST_DATAGRAM + 1, socket.CMSG_SPACE(_CREDENTIALS.size))
    uids = [
        _CREDENTIALS.unpack(raw)[1]
        for level, kind, raw in ancillary
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS)
    ]
    return data, uids[0] if uids else _NOBODY, asker
