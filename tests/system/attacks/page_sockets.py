"""Connections to the page that say nothing, or half of it: the page and its stop button stay within reach."""

import resource
import socket
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

from websockets.sync.client import ClientConnection, connect

from tests.browser import Served, Speaker
from tests.system.rows import Result, Row
from tests.unit.dashboard.talk import CELL

_HALF = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Half: "
_HALF_COUNT, _SILENT_COUNT = 1100, 16
_WAVES = 3  # whoever was turned away comes again
_FILES = 1024  # open ones that most hosts allow a process
_MOST_S = 1.0  # until the page answers
_MOST_LINES = 2  # the link, and that connections were closed
_EVERY_S = 2.0
_PATIENCE_S = 5.0


def rows() -> Iterator[Row]:
    yield Row("attack: half requests at the page", partial(_attacked, _half_requests, 10.0))
    yield Row("attack: silent sockets at the page", partial(_attacked, _silent_sockets, 60.0))


def _half_requests(port: int, _url: str, held: ExitStack) -> None:
    for _ in range(_WAVES * _HALF_COUNT):
        attacker = held.enter_context(socket.create_connection(("127.0.0.1", port)))
        with suppress(OSError):  # was turned away in this moment
            attacker.sendall(_HALF)


def _silent_sockets(port: int, url: str, held: ExitStack) -> None:
    for _ in range(_SILENT_COUNT):
        held.enter_context(socket.create_connection(("127.0.0.1", port)))
        held.enter_context(connect(url))


def _attacked(attack: Callable[[int, str, ExitStack], None], duration_s: float, folder: Path) -> Result:
    with (
        Speaker() as speaker,
        Served(folder, "dashboard", "--cell", CELL, "--connect", speaker.endpoint) as served,
        ExitStack() as held,
    ):
        pid = served.process.process.pid
        resource.prlimit(pid, resource.RLIMIT_NOFILE, (_FILES, _FILES))
        url = f"ws://127.0.0.1:{served.port}/conversation"
        viewer = held.enter_context(connect(url))
        failures = dict.fromkeys(
            _conversed(viewer)
        )  # before the attack, or it would be one more that is silent
        start_s, worst_s = time.monotonic(), 0.0
        attacker = threading.Thread(target=attack, args=(served.port, url, held), daemon=True)
        attacker.start()
        while time.monotonic() - start_s < duration_s:
            took_s = [_took_s(partial(_request, f"{served.url}{path}")) for path in ("", "page.js")]
            # the stop waits 2 s for a slave's answer, which is not the page's
            took_s.append(_took_s(partial(_request, f"{served.url}stop", "POST")) - 2.0)
            worst_s = max(worst_s, *took_s, _took_s(partial(_open, url)))
            failures |= dict.fromkeys(_conversed(viewer))
            time.sleep(_EVERY_S)
        attacker.join()
        log, files = served.process.text, len(list(Path(f"/proc/{pid}/fd").iterdir()))
    lines, tracebacks = log.count("\n"), log.count("Traceback")
    if worst_s >= _MOST_S:
        failures[f"answers after {worst_s:.2f} s, required {_MOST_S:g}"] = None
    if tracebacks or lines > _MOST_LINES:
        failures[f"{lines} lines and {tracebacks} tracebacks in the log"] = None
    return Result(f"answers within {worst_s:.2f} s, {files} files, {lines} lines", [*failures])


def _conversed(viewer: ClientConnection) -> Iterator[str]:
    try:
        viewer.send("{}")
        viewer.recv(_PATIENCE_S)
    except Exception as error:  # noqa: BLE001 - whatever ends it
        yield f"an open page was lost: {type(error).__name__}"


def _took_s(ask: Callable[[], object]) -> float:
    start_s = time.monotonic()
    try:
        ask()
    except Exception:  # noqa: BLE001 - refused, reset or too late, it is no answer
        return _PATIENCE_S
    return time.monotonic() - start_s


def _request(url: str, method: str = "GET") -> None:
    with urllib.request.urlopen(urllib.request.Request(url, method=method), timeout=_PATIENCE_S) as answer:
        answer.read()


def _open(url: str) -> None:
    """Opens a page, and waits until it has its facts."""
    with connect(url, open_timeout=_PATIENCE_S) as page:
        page.recv(_PATIENCE_S)
