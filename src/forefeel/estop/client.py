"""The client of a daemon's control socket: one datagram of JSON each way. Standard library only."""

import json
import os
import socket
from pathlib import Path
from typing import Literal, NamedTuple

from forefeel.common.errors import RunError
from forefeel.common.state.folder import SOCKET

LONGEST_TEXT = 256  # characters of a text, as `messages.ShortText`
_LONGEST_ANSWER = 1 << 16  # bytes; an axis takes some hundred


class Request(NamedTuple):
    """`axis`: of a clearing; None: all. No text is longer than `LONGEST_TEXT`."""

    do: Literal["estop", "clear"]
    reason: str = ""
    axis: str | None = None


class Answer(NamedTuple):
    """`done`: whether what was asked for is so now; `text`: lines for a person."""

    done: bool
    text: tuple[str, ...]
    role: str


def reason_text(reason: str) -> str:
    """Reason as every message takes it, for a bad one must not keep a stop back: cut to `LONGEST_TEXT`, with
    `?` for what is no Unicode, as of an argument with a byte of another encoding.
    """
    return reason.encode("utf-8", "replace").decode()[:LONGEST_TEXT]


def socket_path(folder: Path) -> tuple[int, str]:
    """A descriptor of the folder, to be closed, and a short path of the socket, however deep the folder."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    return descriptor, f"/proc/self/fd/{descriptor}/{SOCKET}"


def ask(folder: Path, request: Request, timeout_s: float = 5.0) -> Answer:
    """Sends a request to the daemon and returns its answer.

    Raises:
        RunError: no daemon runs there, it does not answer in time, or this user may not speak to it.
    """
    try:
        descriptor, path = socket_path(folder)
    except OSError as error:
        raise RunError(f"{folder}: {error.strerror}; expected the state folder of a daemon") from error
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
            asking.settimeout(timeout_s)
            asking.bind("")  # an abstract address, which the kernel chooses, for the answer
            asking.connect(path)
            asking.send(json.dumps(request._asdict()).encode())
            fields = json.loads(asking.recv(_LONGEST_ANSWER))
        return Answer(fields["done"] is True, tuple(map(str, fields["text"])), str(fields["role"]))
    except PermissionError as error:
        raise RunError(
            f"{folder / SOCKET}: {error.strerror}; expected root or the daemon's own user"
        ) from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RunError(f"{folder / SOCKET}: no daemon answers") from error
    finally:
        os.close(descriptor)
