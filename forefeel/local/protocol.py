"""What is said over a daemon's local socket: one line of JSON each way."""

import os
import socket
import struct
from pathlib import Path
from typing import Literal, NamedTuple

LONGEST_LINE = 8192
LONGEST_TEXT = 256
_CREDENTIALS = struct.Struct("3i")


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


def peer_uid(connection: socket.socket) -> int:
    """The user at the other end of a Unix socket, as the kernel knows it."""
    raw = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    uid: int = _CREDENTIALS.unpack(raw)[1]
    return uid
