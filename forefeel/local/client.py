"""Asks a daemon on this machine."""

import json
import os
import socket
from pathlib import Path

from forefeel.common.errors import RunError
from forefeel.common.state.folder import SOCKET
from forefeel.local.protocol import Answer, Request, socket_path

_LONGEST_ANSWER = 1 << 16
"""Bytes. An axis takes some hundred."""


class NobodyThereError(RunError):
    """No daemon answers in that state folder."""


def ask(folder: Path, request: Request, timeout_s: float = 5.0) -> Answer:
    """The daemon's answer.

    Raises:
        NobodyThereError: no daemon runs there, or it does not answer in time.
        RunError: we may not speak to it.
    """
    try:
        descriptor, path = socket_path(folder, SOCKET)
    except OSError as error:
        raise NobodyThereError(
            f"{folder}: {error.strerror}; expected the state folder of a daemon"
        ) from error
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
            asking.settimeout(timeout_s)
            asking.bind("")  # an abstract address, which the kernel chooses, for the answer
            asking.connect(path)
            asking.send(json.dumps(request._asdict()).encode())
            said = json.loads(asking.recv(_LONGEST_ANSWER))
        return Answer(said["done"] is True, tuple(map(str, said["text"])), str(said["role"]))
    except PermissionError as error:
        raise RunError(
            f"{folder / SOCKET}: {error.strerror}; expected root or the daemon's own user"
        ) from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NobodyThereError(f"{folder / SOCKET}: no daemon answers") from error
    finally:
        os.close(descriptor)
