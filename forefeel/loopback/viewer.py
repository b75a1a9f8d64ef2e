"""A dashboard beside a loopback: a viewer in a process of its own, on which the run does not depend."""

import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from forefeel.extras import how_to_get
from forefeel.listening import BACKLOG, INHERITED
from forefeel.parent import child_environment

PORT = 8600  # TCP port of the page, the default of `forefeel dashboard --port`, where it is free
LOG = "dashboard.log"
_END_S = 0.5  # s that the dashboard gets to end by itself
_BEHIND = ["nice", "-n", "19"]


class Watched:
    """One dashboard; what fails of it is said and changes nothing of the run.

    Args:
        opens: the page in the browser.
        say: takes a line for the user.
    """

    def __init__(self, opens: bool, say: Callable[[str], None]) -> None:
        self._opens, self._say = opens, say
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, cell: str, endpoints: Sequence[str], out: Path) -> None:
        """Starts it at the lowest priority; its words go to a log file beside the recording."""
        if find_spec("nicegui") is None:
            self._say(f"dashboard: {how_to_get('dashboard')}")
            return
        try:
            with _listening() as listening, (out / LOG).open("wb") as log:
                port, fileno = listening.getsockname()[1], listening.fileno()
                self._process = subprocess.Popen(
                    [*_BEHIND, sys.executable, *self._words(cell, endpoints, port)],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,
                    env={**child_environment(), INHERITED: str(fileno)},
                    pass_fds=[fileno],
                )
        except OSError as error:
            self._say(f"dashboard: {error.strerror or error}")
            return
        self._say(f"dashboard at http://127.0.0.1:{port}/ while it runs")

    def _words(self, cell: str, endpoints: Sequence[str], port: int) -> list[str]:
        connect = [word for endpoint in endpoints for word in ("--connect", endpoint)]
        words = ["-m", "forefeel", "dashboard", "--cell", cell, "--port", str(port), *connect]
        return [*words, "--open"] if self._opens else words

    def ask_to_end(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)

    def end(self) -> None:
        """However it is; a dashboard that failed has said so in its log."""
        if self._process is None:
            return
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def _listening() -> socket.socket:
    """At the usual port, or at any; whoever opens the page before it is served waits and is not refused."""
    try:
        return socket.create_server(("127.0.0.1", PORT), backlog=BACKLOG)
    except OSError:
        return socket.create_server(("127.0.0.1", 0), backlog=BACKLOG)
