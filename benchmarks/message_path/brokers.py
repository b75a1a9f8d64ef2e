"""Brokers of Debian's packages, on loopback, for the length of a measurement."""

import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path

_VERSION = {"mosquitto": "-h", "nats-server": "--version", "redis-server": "--version"}
_STARTING_S = 10.0  # s until a broker must listen


def broker_version(name: str) -> str:
    """The first line that it says of itself."""
    done = subprocess.run([_found(name), _VERSION[name]], capture_output=True, text=True, check=False)
    words = (done.stdout or done.stderr).splitlines()[0].split()
    number = next((word for word in words if word.lstrip("v=")[:1].isdigit()), "?")
    return f"{name} {number.lstrip('v=')}"


def broker(name: str | None, port: int, folder: Path) -> AbstractContextManager[None]:
    """The broker while it runs, or nothing.

    Raises:
        FileNotFoundError: it is not installed.
    """
    return nullcontext() if name is None else _running(name, port, folder)


@contextmanager
def _running(name: str, port: int, folder: Path) -> Iterator[None]:
    command = [_found(name), *_options(name, port, folder)]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder
    ) as process:
        try:
            _await(port)
            yield
        finally:
            process.terminate()


def _options(name: str, port: int, folder: Path) -> list[str]:
    if name == "mosquitto":
        file = folder / "mosquitto.conf"
        file.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nset_tcp_nodelay true\n")
        return ["-c", str(file)]
    if name == "nats-server":
        return ["--addr", "127.0.0.1", "--port", str(port)]
    return ["--bind", "127.0.0.1", "--port", str(port), "--save", "", "--appendonly", "no"]


def _found(name: str) -> str:
    path = shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/bin")
    if path is None:
        raise FileNotFoundError(f"{name} is not installed")
    return path


def _await(port: int) -> None:
    end_s = time.monotonic() + _STARTING_S
    while time.monotonic() < end_s:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), 0.2):
            return
        time.sleep(0.05)
    raise TimeoutError(f"port {port}: nobody listens after {_STARTING_S:g} s")
