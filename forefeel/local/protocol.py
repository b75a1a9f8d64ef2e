"""What is said over a daemon's local socket: one line of JSON each way."""

import os
import socket
import struct
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

LONGEST_LINE = 8192
_CREDENTIALS = struct.Struct("3i")
Text = Annotated[str, Field(max_length=256)]


class _Said(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(frozen=True, extra="forbid", strict=True)


class Request(_Said):
    """`axis`: of a clearing; None: all."""

    do: Literal["state", "estop", "clear"]
    reason: Text = ""
    axis: Text | None = None


class AxisAnswer(_Said):
    """One axis; at a master the slave's state as it is heard."""

    name: str
    state: str
    reason: str


class Answer(_Said):
    """`done`: whether what was asked for is so now; `text`: in words, a line for each thing."""

    done: bool
    text: tuple[str, ...]
    role: str
    axes: tuple[AxisAnswer, ...]


def socket_path(folder: Path, name: str) -> tuple[int, str]:
    """A descriptor of the folder, to be closed, and a path through it that is short whatever the folder."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    return descriptor, f"/proc/self/fd/{descriptor}/{name}"


def peer_uid(connection: socket.socket) -> int:
    """The user at the other end of a Unix socket, as the kernel knows it."""
    raw = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    uid: int = _CREDENTIALS.unpack(raw)[1]
    return uid
