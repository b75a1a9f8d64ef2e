"""The page beside a loopback, in a process of its own, on which the run does not depend."""

import socket
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Self

from forefeel.child_process import LISTENING, listening_at
from forefeel.common.errors import EndpointError
from forefeel.dashboard.scene import Scene
from forefeel.interrupt import signal_flag
from forefeel.loopback.child import Child, free_endpoints

PORT = 8600  # TCP port of the page, the default of `forefeel dashboard --port`, where it is free
CELL = "loopback"
_END_S = 0.5  # the dashboard holds nothing that has to be kept
_POLL_S = 0.1  # s between two looks for its end


class DashboardProcess:
    """One dashboard for all runs of a command; where it fails they go on.

    Args:
        out: where its log goes, when it starts.
        opens: the page in the browser.
        say: takes a line for the user.
        port: where the page is served if it is free, else at any.

    Attributes:
        endpoints: where it connects to the slave and to the master of each run.
        url: of the page; empty where there is none.
        until: when it ends, in words.
        scene: what it shows.
    """

    def __init__(self, out: Path, opens: bool, say: Callable[[str], None], port: int = PORT) -> None:
        self.endpoints = free_endpoints(2)
        self.url = ""
        self._stays = sys.stdout.isatty()
        self.until = "Ctrl-C" if self._stays else "nobody looks"
        self._out, self._opens, self._say, self._port = out, opens, say, port
        self.scene = Scene()
        self._child: Child | None = None
        self._started = False

    def start(self) -> None:
        """Starts the dashboard's process at the first call, once `out` exists, and sets `url`; says where it
        is. A failure (no extra, no port) is a line for the user, and `url` stays empty. Later calls do
        nothing.
        """
        if self._started:
            return
        self._started = True
        if find_spec("starlette") is None:
            self._say("dashboard: needs an extra: pip install 'forefeel[dashboard]'")
            return
        connect = [word for endpoint in self.endpoints for word in ("--connect", endpoint)]
        words = ["dashboard", "--told", "--cell", CELL, *connect]
        words += ["--open"] if self._opens else []
        try:
            with _listening(self._port) as listening:
                fileno = listening.fileno()
                child = Child("dashboard", words, self._out, _END_S)
                child.start({LISTENING: str(fileno)}, [fileno], hears=True)
                self.url = f"http://127.0.0.1:{listening.getsockname()[1]}/"
        except OSError as error:
            self._say(f"dashboard: {error.strerror or error}")
            return
        self._child = child
        self._say(f"dashboard at {self.url}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        if self._child is not None:
            self._child.end()

    def tell(self, scene: Scene) -> None:
        """Shows that scene from now on."""
        self.scene = scene
        if self._child is not None:
            self._child.tell(scene.model_dump_json())

    def stay(self, scene: Scene) -> None:
        """Shows the last scene until a signal or the end of the process, which ends by itself where stdout is
        no terminal and nobody looks; returns at once without a process.
        """
        if self._child is None:
            return
        with signal_flag() as stop:
            self.tell(scene.model_copy(update={"stays": self._stays}))
            self._child.close_input()
            while self._child.running and not stop.wanted():
                time.sleep(_POLL_S)


def _listening(port: int) -> socket.socket:
    """Listens at that port, or at any; a page opened before it is served waits, and is not refused."""
    try:
        return listening_at("127.0.0.1", port)
    except EndpointError:
        return listening_at("127.0.0.1", 0)
