"""A process that was started by another of ours."""

import ctypes
import os
import signal

from forefeel.common.errors import RunError

_PR_SET_PDEATHSIG = 1  # option of prctl(2) (linux/prctl.h)
_PARENT = "FOREFEEL_PARENT"


def child_environment() -> dict[str, str]:
    """That of this process, for one that it starts and that dies with it."""
    return {**os.environ, _PARENT: str(os.getpid())}


def die_with_parent() -> None:
    """A process that another of ours started with `child_environment` does not outlive it, however it ends.

    Raises:
        RunError: it has ended.
    """
    parent = os.environ.get(_PARENT)
    if parent is None:
        return
    die_with(int(parent), signal.SIGTERM)


def die_with(parent: int, number: signal.Signals) -> None:
    """This process gets that signal when its parent, which has that id, ends.

    Raises:
        RunError: it has ended.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)
    if os.getppid() != parent:  # it ended before we asked for the signal
        raise RunError("the process that started this one has ended")
