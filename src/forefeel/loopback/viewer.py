"""The page beside a loopback, in a process of its own, on which the run does not depend."""

import sys
from importlib.util import find_spec
from pathlib import Path

from forefeel.child_process import ChildProcess, free_endpoints, next_listening
from forefeel.common.errors import EndpointError
from forefeel.dashboard.scene import Scene
from forefeel.interrupt import signal_flag
from forefeel.terminal import say

PORT = 8600  # TCP port of the page, the default of `forefeel dashboard --port`, where it is free
CELL = "loopback"
_END_S = 0.5  # the dashboard holds nothing that has to be kept
_POLL_S = 0.1  # s between two looks for its end


class DashboardProcess(ChildProcess):
    """One dashboard for all runs of a command; where it fails they go on.

    Args:
        out: where its log goes, when it starts.
        opens: the page in the browser.
        wanted: False for one that never starts.
        port: where the page is served, or at the next free one.

    Attributes:
        endpoints: where it connects to the slave and to the master of each run.
        url: of the page; empty where there is none.
        until: when it ends, in words.
        scene: what it shows.
    """

    def __init__(self, out: Path, opens: bool, wanted: bool = True, port: int = PORT) -> None:
        self.endpoints = free_endpoints(2)
        connect = [word for endpoint in self.endpoints for word in ("--connect", endpoint)]
        words = ["dashboard", "--told", "--cell", CELL, *connect, *(["--open"] if opens else [])]
        super().__init__("dashboard", words, out, _END_S)
        self._port, self._wanted = port, wanted
        self.url = ""
        self.until = "Ctrl-C" if sys.stdout.isatty() else "nobody looks"
        self.scene = Scene()

    def serve(self) -> None:
        """Starts the process at the first call, if wanted; sets `url` and prints it. A failure (no extra, no
        folder `out`) is a line for the user, and `url` stays empty. Later calls do nothing.
        """
        if not self._wanted:
            return
        self._wanted = False
        if find_spec("starlette") is None:
            say("dashboard: needs an extra: pip install 'forefeel[dashboard]'")
            return
        try:
            # a page opened before it is served waits, and is not refused
            with next_listening("127.0.0.1", self._port) as listening:
                self.start(listening)
                self.url = f"http://127.0.0.1:{listening.getsockname()[1]}/"
            say(f"dashboard at {self.url}")
        except (OSError, EndpointError) as error:
            say(f"dashboard: {getattr(error, 'strerror', None) or error}")

    def show(self, scene: Scene, last: bool = False) -> None:
        """Sends the page that scene, if it runs, and stores it as `scene`; after the `last` none follows."""
        self.scene = scene
        self.write(scene.model_dump_json(), last)

    def stay(self, felt: str, recording: Path, pages: dict[str, Path]) -> None:
        """Shows the end of a run, with the text on the felt force, until a signal or the end of the process,
        which ends by itself where stdout is no terminal and nobody looks; returns at once without a process.
        """
        head, stays = f"Ended. Felt force: {felt}", sys.stdout.isatty()
        with signal_flag() as stop:
            self.show(Scene(head=head, recording=recording, pages=pages, stays=stays), last=True)
            for _ in stop.polls(None, _POLL_S):
                if not self.running:
                    return
