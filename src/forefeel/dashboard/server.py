"""The process that serves the page, until Ctrl-C or until the command that started it has told all."""

import asyncio
import math
import os
import socket
import time
import webbrowser
from collections.abc import Callable, Collection, Coroutine, Sequence
from contextlib import closing, nullcontext, suppress
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, TextIO

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import Scope
from uvicorn.protocols.http.h11_impl import H11Protocol

from forefeel.child_process import die_with_parent, listening_at, next_listening
from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.messages import SafetyState
from forefeel.common.topics import SLAVE_STATE
from forefeel.common.transport.port import Transport
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.dashboard.admission import guard
from forefeel.dashboard.endpoint import CONVERSATION, RESULTS, Endpoint
from forefeel.dashboard.scene import Scene
from forefeel.dashboard.sources import LiveCell
from forefeel.estop.network import EVERY_S, FOR_S, Stopper
from forefeel.interrupt import signal_flag
from forefeel.network_settings import ObserverSettings
from forefeel.reachability import cell_watch
from forefeel.report.vessel import VesselSettings
from forefeel.terminal import ask, say

_POLL_S = 0.2  # s between two looks for an end
_NICE = 5  # niceness that is added (nice(2)): behind the daemons and other programs
_LINGER_S = 10.0  # s that a page has for a reload when all is told
_WAITING = 2048  # each holds on to the 4 KB that it came in; a starved viewer shows the newest, not all
MOST_CONNECTIONS = 512  # of the 1024 files that most hosts allow a process; 16 browsers open at most 96
HEAD_S = 10.0  # s that a request may take to arrive
_NOTICE_S = 60.0  # s between two lines about connections that gave way
_BACKLOG = MOST_CONNECTIONS // 4  # connections accepted at a time, so that a request is read first
_STATIC = Path(__file__).parent / "static"
_end_at_once = partial(os._exit, 0)  # in order it takes seconds on a busy machine, and nothing is to be saved
# asked for anew with every load; nothing comes from elsewhere or stands inside another page
_HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


def run_dashboard(
    settings: ObserverSettings,
    address: str,
    port: int,
    insecure: bool,
    opens: bool,
    vessel: VesselSettings | None,
    scenes: TextIO | None = None,
) -> None:
    """Serves the page of a live cell, with its stop button, until SIGINT, SIGTERM or SIGHUP, which end the
    process at once, as does the end of the forefeel that started it. Lowers the priority of the process;
    `opens`: in a browser.

    `scenes`: lines of JSON, each a `Scene`; the newest is shown. Then it also returns once they have ended
    and no page is open, unless the last one stays, and a failed network is not raised.

    Raises:
        InputError: an endpoint, a certificate or the port can not be used.
        RunError: the network failed, or what the page is made of.
    """
    die_with_parent()
    clock, failed = MonotonicClock(), list[Exception]()
    listening = listening_at(address, port)
    with listening:
        where = ", ".join(settings.transport.connect + settings.transport.listen)
        live = LiveCell(settings.cell, where, clock)
        party = Party("viewer", (settings.cell,))
        transport = ZenohTransport.open(settings.transport, clock, failed.append, party, insecure=insecure)
        with signal_flag(_end_at_once), closing(transport):
            _lower_priority()
            button = StopButton(transport, settings.cell, clock)

            def hear(key: str, payload: bytes, receive_ns: int) -> None:
                if key.endswith(SLAVE_STATE.name):  # of 3,000 messages a second the 50 that say it
                    button.hear(key, payload, receive_ns)
                live.hear(key, payload, receive_ns)

            transport.subscribe_all(f"forefeel/{settings.cell}", hear, _WAITING)
            if transport.notice:
                say(transport.notice)
            routes = [Route("/stop", button.press, methods=["POST"])]
            endpoint = Endpoint(live, Scene(vessel=vessel))
            watch = cell_watch(settings.transport, party, transport, clock)
            ends = _follow(endpoint, scenes) if scenes else _failure(failed, lambda: live.update_cause(watch))
            _serve(listening, address, endpoint, f"cell {settings.cell}", opens, ends, routes)


def run_view(file: Path, address: str, port: int, opens: bool, vessel: VesselSettings | None) -> None:
    """Serves the page of a recording, and the results that lie beside it, until SIGINT, SIGTERM or SIGHUP,
    which end the process at once. Lowers the process's priority; `opens`: in a browser. Where the port is
    taken it is the next free one.

    Raises:
        InputError: the file or the port can not be used.
        RunError: what the page is made of failed.
    """
    beside = {"report": file.parent / "report.html", "diagnosis": file.parent / "diagnosis" / "report.html"}
    pages = {words: path for words, path in beside.items() if path.is_file()}
    endpoint = Endpoint(None, Scene(recording=file, pages=pages, vessel=vessel))
    _lower_priority()
    with signal_flag(_end_at_once), next_listening(address, port) as listening:
        _serve(listening, address, endpoint, str(file), opens, _failure(()))


def _lower_priority() -> None:
    """Puts this process behind those that move something."""
    with suppress(OSError):
        os.nice(_NICE)


class StopButton:
    """An emergency stop for every axis of the cell, repeated until each shows it.

    Sends what the viewer's certificate may send: anyone but a recorder may stop.
    """

    def __init__(self, transport: Transport, cell: str, clock: Clock) -> None:
        self._clock = clock
        # zenoh 1.10 keeps some 250 bytes of each message that two subscriptions of a session take (measured)
        self._stopper = Stopper(transport, cell, (), "dashboard", "", listens=False)
        self.hear = self._stopper.hear

    async def press(self, asked: Request) -> JSONResponse:
        """Sends the stop to every axis, again and again, until each shows ESTOPPED after the press, 2 s at
        most. Answers with JSON: `running`, the axes that do not; `heard`, false if none was ever heard.
        """
        stopper = self._stopper
        stopper.asked_ns = self._clock.now_ns()
        stopper.reason = f"page, from {asked.client.host if asked.client else 'unknown'}"
        for _ in range(round(FOR_S / EVERY_S)):
            stopper.publish(self._clock.now_ns())  # once in any case: what was heard may be of an earlier run
            await asyncio.sleep(EVERY_S)
            states = stopper.outcome()
            running = [axis for axis, state in states.items() if state != SafetyState.ESTOPPED.value]
            if states and not running:
                break
        return JSONResponse({"heard": bool(states), "running": running})


class Connection(H11Protocol):
    """HTTP connection of uvicorn that gives way: one that asks nothing keeps nobody from the stop button.

    It is silent until the head of its request is complete, and again once that is answered. A WebSocket is
    none of these any more: `Endpoint` bounds them, and ends one by `state.abort`.
    """

    _noticed_s = -math.inf  # by the class, for all connections
    since_s: float  # when it connected, or was last answered

    @property
    def silent(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Takes a connection; where there are too many closes the oldest without a request in progress,
        else the oldest, and prints so once a minute at most. Puts the transport's `abort` into the
        application's state.
        """
        self.since_s = self.loop.time()
        oldest = displaced([peer for peer in self.connections if isinstance(peer, Connection)])
        if oldest is not None:
            self.connections.discard(oldest)  # its transport tells it only later
            oldest.transport.abort()
            if self.since_s - Connection._noticed_s > _NOTICE_S:
                Connection._noticed_s = self.since_s
                say(f"page: more than {MOST_CONNECTIONS} connections, the oldest silent ones are closed")
        super().connection_made(transport)
        # a WebSocket whose peer does not answer a close frame would stay for 10 s
        self.app_state = self.app_state | {"abort": transport.abort}

    def on_response_complete(self) -> None:
        self.since_s = self.loop.time()
        super().on_response_complete()


def displaced(peers: Collection[Connection]) -> Connection | None:
    """Connection to close for a new one: the oldest silent one, or else the oldest. None: there is room."""
    if len(peers) < MOST_CONNECTIONS:
        return None
    return min([peer for peer in peers if peer.silent] or peers, key=attrgetter("since_s"))


def overdue(peers: Collection[Connection], now_s: float) -> list[Connection]:
    """Connections whose request did not arrive within `HEAD_S`."""
    return [peer for peer in peers if peer.silent and now_s - peer.since_s > HEAD_S]


class _Server(uvicorn.Server):
    """Server that leaves signals alone, and aborts connections that are `overdue` in each tick."""

    capture_signals = nullcontext  # type: ignore[assignment]

    async def on_tick(self, counter: int) -> bool:
        connections = [peer for peer in self.server_state.connections if isinstance(peer, Connection)]
        for peer in overdue(connections, time.monotonic()):
            peer.transport.abort()
        return await super().on_tick(counter)


class _Files(StaticFiles):
    """Static files with `_HEADERS`."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        answer = await super().get_response(path, scope)
        answer.headers.update(_HEADERS)
        return answer


def _serve(
    listening: socket.socket,
    address: str,
    endpoint: Endpoint,
    what: str,
    opens: bool,
    ends: Coroutine[Any, Any, None],
    more: Sequence[BaseRoute] = (),
) -> None:
    """Serves the page, with the checks of `guard`, until `ends` does; prints its link, with `opens` opens it
    in a browser. `address`: as the user gave it; `what`: what is shown, for messages; `more`: other routes.

    Raises:
        RunError: `ends`, or what the page is made of, failed.
    """
    routes = [
        *more,
        WebSocketRoute(CONVERSATION, endpoint.converse),
        Route(RESULTS, endpoint.result),
        Mount("/", _Files(directory=_STATIC, html=True)),
    ]
    app = Starlette(routes=routes)
    link = guard(app, listening, address)
    tell = ask if link.secret else say  # without the link nobody could see the page
    tell(f"dashboard of {what} at {link.url}; Ctrl-C ends")
    if opens:
        webbrowser.open(link.url)
    config = uvicorn.Config(
        app,
        http=Connection,
        log_level="error",
        ws_max_size=65536,
        timeout_graceful_shutdown=1,
        backlog=_BACKLOG,
    )
    try:
        asyncio.run(_serve_until(_Server(config), listening, ends))
    except Exception as error:
        raise RunError(f"dashboard of {what}: {type(error).__name__}: {error}") from error


async def _serve_until(server: _Server, listening: socket.socket, ends: Coroutine[Any, Any, None]) -> None:
    """Runs the server until it or `ends` has ended, then ends the server; raises the error of either."""
    serving, ending = asyncio.create_task(server.serve([listening])), asyncio.create_task(ends)
    await asyncio.wait((serving, ending), return_when=asyncio.FIRST_COMPLETED)
    server.should_exit = True
    await serving
    if ending.done():
        ending.result()


async def _failure(failed: Sequence[Exception], look: Callable[[], object] = lambda: None) -> None:
    """Waits for a failure and raises it; calls `look` meanwhile."""
    while not failed:
        look()
        await asyncio.sleep(_POLL_S)
    raise failed[0]


async def _follow(endpoint: Endpoint, lines: TextIO) -> None:
    """Shows each scene of `lines`, a pipe of JSON, as it comes; after the last returns once no page was open
    for 10 s, never where that scene stays.
    """
    reader = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), lines)
    while line := await reader.readline():
        endpoint.show(Scene.model_validate_json(line))
    seen_s = time.monotonic()
    while endpoint.scene.stays or time.monotonic() - seen_s < _LINGER_S:
        await asyncio.sleep(_POLL_S)
        if endpoint.open:
            seen_s = time.monotonic()
