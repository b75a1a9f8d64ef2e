"""A process that was started by another of ours."""

import ctypes
import os
import signal

from common.errors import RunError

_PR_SET_PDEATHSIG = 1
_PARENT = "FOREFEEL_PARENT"


def child_environment() -> dict[str, str]:
    """That of this process, for one that it starts and that dies with it."""
    return {**os.environ, _PARENT: str(os.getpid())}


def die_with_parent() -> None:
    """A daemon that a loopback started does not outlive it, however that ends."""
    parent = os.environ.get(_PARENT)
    if parent is None:
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != int(parent):  # it ended before we asked for the signal
        raise RunError("the loopback that started this daemon has ended")
