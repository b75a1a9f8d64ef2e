"""Network namespaces of our own: made, entered by one thread, deleted."""

import ctypes
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_CLONE_NEWNET = 0x40000000


def ip(*words: str) -> None:
    """iproute2.

    Raises:
        AssertionError: it refused.
    """
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr.strip()}"


def remove(name: str) -> None:
    """A namespace and the devices in it; one that is not there is none."""
    subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


@contextmanager
def inside(name: str) -> Iterator[None]:
    """This thread is in the namespace meanwhile; what it opens there stays there."""
    before = Path("/proc/thread-self/ns/net")
    home = os.open(before, os.O_RDONLY)
    there = os.open(f"/run/netns/{name}", os.O_RDONLY)
    try:
        _enter(there)
        yield
    finally:
        _enter(home)
        os.close(there)
        os.close(home)


def _enter(namespace: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(namespace, _CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "setns")
