"""A dashboard beside a loopback, in a process of its own, on which the run does not depend."""

import socket
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from forefeel.child_process import LISTENING, listening_at
from forefeel.common.errors import EndpointError
from forefeel.loopback.child import Child

PORT = 8600  # TCP port of the page, the default of `forefeel dashboard --port`, where it is free
LOG = "dashboard.log"
_END_S = 0.5  # the dashboard holds nothing that has to be kept


class DashboardProcess:
    """One dashboard, which steps behind the daemons once it serves; where it fails the run goes on.

    Args:
        opens: the page in the browser.
        say: takes a line for the user.
        port: where the page is served if it is free, else at any.
    """

    def __init__(self, opens: bool, say: Callable[[str], None], port: int = PORT) -> None:
        self._opens, self._say, self._port = opens, say, port
        self._child: Child | None = None

    def start(self, cell: str, endpoints: Sequence[str], out: Path) -> None:
        if find_spec("starlette") is None:
            self._say("dashboard: needs an extra: pip install forefeel[dashboard]")
            return
        try:
            with _listening(self._port) as listening:
                port, fileno = listening.getsockname()[1], listening.fileno()
                child = Child("dashboard", self._words(cell, endpoints, port), out, _END_S)
                child.start({LISTENING: str(fileno)}, [fileno])
        except OSError as error:
            self._say(f"dashboard: {error.strerror or error}")
            return
        self._child = child
        self._say(f"dashboard at http://127.0.0.1:{port}/ while it runs")

    def _words(self, cell: str, endpoints: Sequence[str], port: int) -> list[str]:
        connect = [word for endpoint in endpoints for word in ("--connect", endpoint)]
        words = ["-m", "forefeel", "dashboard", "--cell", cell, "--port", str(port), *connect]
        return [*words, "--open"] if self._opens else words

    def ask_to_end(self) -> None:
        if self._child is not None:
            self._child.ask_to_end()

    def end(self) -> None:
        if self._child is not None:
            self._child.end()


def _listening(port: int) -> socket.socket:
    """At that port, or at any; whoever opens the page before it is served waits and is not refused."""
    try:
        return listening_at("127.0.0.1", port)
    except EndpointError:
        return listening_at("127.0.0.1", 0)
