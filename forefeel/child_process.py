"""A process that another of ours starts: it does not outlive its parent, and may inherit a socket."""

import ctypes
import os
import signal
import socket

from forefeel.common.errors import EndpointError, RunError

_PR_SET_PDEATHSIG = 1  # option of prctl(2) (linux/prctl.h)
_PARENT = "FOREFEEL_PARENT"
LISTENING = "FOREFEEL_LISTENING"
_BACKLOG = 64  # connections that the kernel keeps before they are accepted: pages that open during the start


def child_environment() -> dict[str, str]:
    """Environment of a process that dies with this one."""
    return {**os.environ, _PARENT: str(os.getpid())}


def die_with_parent() -> None:
    """Ends this process with its parent, however that ends, if `child_environment` was given to it.

    Raises:
        RunError: it has ended.
    """
    parent = os.environ.get(_PARENT)
    if parent is not None:
        die_with(int(parent), signal.SIGTERM)


def die_with(parent: int, number: signal.Signals) -> None:
    """Has the kernel send this process a signal when its parent, which has that id, ends.

    Raises:
        RunError: it has ended.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)
    if os.getppid() != parent:  # it ended before we asked for the signal
        raise RunError("the process that started this one has ended")


def listening_at(address: str, port: int) -> socket.socket:
    """Socket that listens at address and port before its server is there: the one inherited from the parent
    (the descriptor in the variable `LISTENING`, which is removed; address and port do not count), else a new
    one.

    Raises:
        EndpointError: the port is taken, or the address is not of this host.
    """
    inherited = os.environ.pop(LISTENING, None)
    if inherited is not None:
        return socket.socket(fileno=int(inherited))
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        return socket.create_server((address, port), family=family, backlog=_BACKLOG)
    except OSError as error:
        reason = str(error.strerror).partition(" (")[0]  # Python adds the address
        raise EndpointError(f"--port {port} at {address}: {reason}; expected a free one") from error
