"""A process that a loopback run starts; its output goes to a log file beside the recording."""

import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from forefeel.child_process import child_environment
from forefeel.common.errors import InputError, RunError


class Child:
    """`forefeel WORDS`, started in a session of its own, so that only the run gets the terminal's Ctrl-C.

    Args:
        end_s: s from SIGTERM to SIGKILL.
    """

    def __init__(self, name: str, words: Sequence[str], out: Path, end_s: float = 10.0) -> None:
        self.name = name
        self.log = out / f"{name}.log"
        self._command = [sys.executable, "-m", "forefeel", *words]
        self._end_s = end_s
        self._process: subprocess.Popen[bytes] | None = None

    def start(
        self, environment: Mapping[str, str] = {}, descriptors: Sequence[int] = (), hears: bool = False
    ) -> None:
        """Starts the process, its output to `log`, with more `environment` and inherited `descriptors`;
        `hears`: with a pipe for `tell`, else without input. It dies with this process.
        """
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE if hears else subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                env={**child_environment(), **environment},
                pass_fds=descriptors,
            )

    def tell(self, line: str) -> None:
        """Writes a line to its standard input, unless it has ended."""
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()

    def close_input(self) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()

    @property
    def running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def end(self) -> None:
        """Ends the process by SIGTERM, or SIGKILL `end_s` later, and waits for its end; nothing if it was not
        started.
        """
        if self._process is None:
            return
        self._process.terminate()  # one that has ended does not hear it
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
        if code == 0:
            return
        words = self.log.read_text(errors="replace").strip().splitlines()
        last = words[-1].removeprefix("forefeel: ") if words else "no word"
        if code == 2:
            raise InputError(f"{self.name}: {last}")
        raise RunError(f"the {self.name} ended with code {code}: {last} (see {self.log})")


def free_endpoints(count: int) -> list[str]:
    """Endpoints of this host at which nobody listens now."""
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    endpoints = [f"tcp/127.0.0.1:{listening.getsockname()[1]}" for listening in sockets]
    for listening in sockets:
        listening.close()
    return endpoints
