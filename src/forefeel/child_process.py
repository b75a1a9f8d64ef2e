"""Processes that another of ours starts: each ends with its parent, and may inherit a socket."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Self

from forefeel.common.errors import EndpointError, InputError, RunError

_PR_SET_PDEATHSIG = 1  # option of prctl(2) (linux/prctl.h)
_PARENT, _LISTENING = "FOREFEEL_PARENT", "FOREFEEL_LISTENING"
_PORTS = 20  # that are tried, one after the other
_BACKLOG = 64  # connections that the kernel keeps before they are accepted: pages that open during the start


class ChildProcess:
    """`forefeel WORDS`, in a session of its own, so that only its parent gets the terminal's Ctrl-C; as a
    context manager it ends with the body. Its output goes to the file out/NAME.log, `log`.

    Args:
        end_s: s from SIGTERM to SIGKILL.
    """

    def __init__(self, name: str, words: Sequence[str], out: Path, end_s: float = 10.0) -> None:
        self.name, self.log = name, out / f"{name}.log"
        self._words, self._end_s = words, end_s
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, listening: socket.socket | None = None) -> None:
        """Starts the process without input, in a session of its own, its output to a new log. With a socket,
        which it inherits for `listening_at`, its input is a pipe for `write`. OSError: it can not be started,
        or its log not be written.
        """
        environment, descriptors = {**os.environ, _PARENT: str(os.getpid())}, list[int]()
        if listening is not None:
            descriptors.append(listening.fileno())
            environment[_LISTENING] = str(listening.fileno())
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "forefeel", *self._words],
                stdin=subprocess.PIPE if descriptors else subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                env=environment,
                pass_fds=descriptors,
            )

    @property
    def running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def write(self, line: str, last: bool = False) -> None:
        """Writes a line to the pipe and, if `last`, closes it; nothing without a pipe, or to a broken one."""
        pipe = self._process and self._process.stdin
        if pipe:
            with suppress(OSError):
                pipe.write(f"{line}\n".encode())
                pipe.flush()
                if last:
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Ends the process, if started, by SIGTERM, or SIGKILL `end_s` later, and waits for its end."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(self._end_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def check(self) -> None:
        """Raises InputError if the process ended with exit code 2, RunError for any other but 0, with the
        last line of its log. To be called once it has ended.
        """
        code = self._process.returncode if self._process else None
        if code != 0:
            *_, last = ["no word", *self.log.read_text(errors="replace").strip().splitlines()]
            last = last.removeprefix("forefeel: ")
            if code == 2:
                raise InputError(f"{self.name}: {last}")
            raise RunError(f"the {self.name} ended with code {code}: {last} (see {self.log})")


def die_with_parent(number: signal.Signals = signal.SIGTERM, parent: int | None = None) -> None:
    """Has the kernel send this process a signal when its parent ends, however that ends. `parent`: its id;
    None: that of the `ChildProcess` that started this one; where none has, it does nothing.

    Raises:
        RunError: the parent has ended.
    """
    expected = os.environ.get(_PARENT) if parent is None else parent
    if expected is None:
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)
    if os.getppid() != int(expected):  # it ended before we asked for the signal
        raise RunError("the process that started this one has ended")


def listening_at(address: str, port: int) -> socket.socket:
    """Socket that listens at address and port before its server is there: the one inherited from the parent
    (the descriptor in the variable `FOREFEEL_LISTENING`, which is removed; address and port do not count),
    else a new one.

    Raises:
        EndpointError: the port is taken, or the address is not of this host.
    """
    inherited = os.environ.pop(_LISTENING, None)
    if inherited is not None:
        return socket.socket(fileno=int(inherited))
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        return socket.create_server((address, port), family=family, backlog=_BACKLOG)
    except OSError as error:
        reason = str(error.strerror).partition(" (")[0]  # Python adds the address
        raise EndpointError(f"--port {port} at {address}: {reason}; expected a free one") from error


def next_listening(address: str, port: int) -> socket.socket:
    """Socket as of `listening_at`, at the next free port where that one is taken; raises as it."""
    for candidate in range(port, min(port + _PORTS, 65536)):
        with suppress(EndpointError):
            return listening_at(address, candidate)
    return listening_at(address, port)


def free_endpoints(count: int) -> list[str]:
    """TCP endpoints of this host, as many as `count`, at which nobody listens now."""
    with ExitStack() as open_now:
        sockets = [open_now.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [f"tcp/127.0.0.1:{listening.getsockname()[1]}" for listening in sockets]
