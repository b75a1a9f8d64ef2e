"""The process that serves the page, until Ctrl-C."""

import asyncio
import logging
import os
import socket
import time
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, closing, nullcontext, suppress
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from forefeel.child_process import die_with_parent, listening_at
from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import RunError
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.dashboard.admission import guard
from forefeel.dashboard.conversation import PATH, Conversations
from forefeel.dashboard.diagnosing import Diagnosing
from forefeel.dashboard.page import build, serve_files
from forefeel.dashboard.sources import LiveCell, RecordedSource, Source
from forefeel.interrupt import heeded
from forefeel.network_settings import ObserverSettings
from forefeel.terminal import ask, say

_POLL_S = 0.2  # s between two looks for an end
# niceness that is added (nice(2)): behind the daemons and other programs, before a diagnosis at 19
_NICE = 10
_WAITING = 2048  # each holds on to the 4 KB that it came in; a starved viewer shows the newest, not all
_PATIENCE_S = 30.0  # a page that stalls is not made to load anew
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32"'
    ' fill="#141a21"/><path d="M4 18c4-14 8-14 12-2s8 12 12-2" fill="none"'
    ' stroke="#56b4e9" stroke-width="3"/></svg>'
)
Background = Callable[[], Awaitable[None]]


def run_dashboard(
    settings: ObserverSettings, address: str, port: int, duration_s: float | None, insecure: bool, opens: bool
) -> None:
    """Shows a live cell until SIGINT, SIGTERM, SIGHUP or the duration.

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
        with heeded(_exit), closing(transport):
            _step_back()
            transport.subscribe_all(f"forefeel/{settings.cell}", live.hear, _WAITING)
            if transport.notice:
                say(transport.notice)
            diagnosing = Diagnosing(live.look)
            live.findings = diagnosing.findings
            page = Page(listening, live, f"cell {settings.cell}", failed, address)
            page.serve(opens, [diagnosing.run, lambda: _until(duration_s, failed)])


def run_view(file: Path, address: str, port: int, duration_s: float | None, opens: bool) -> None:
    """Shows a recording until SIGINT, SIGTERM, SIGHUP or the duration.

    Raises:
        InputError: the file or the port can not be used.
        RunError: what the page is made of failed.
    """
    recorded = RecordedSource(file)
    _step_back()
    with heeded(_exit), listening_at(address, port) as listening:
        page = Page(listening, recorded, str(file), [], address)
        page.serve(opens, [lambda: _until(duration_s, [])])


def _exit() -> None:
    """A server that keeps nothing would take seconds to come down in order on a busy machine."""
    os._exit(0)


def _step_back() -> None:
    """Whoever looks stands behind those who move something."""
    with suppress(OSError):
        os.nice(_NICE)


class _Server(uvicorn.Server):
    capture_signals = nullcontext  # type: ignore[assignment]


class Page:
    """The page and what runs beside it.

    Args:
        what: it shows, in words.
        failed: what has failed; the page does not go on without it.
        address: where it was asked to listen, maybe a name.
    """

    def __init__(
        self,
        listening: socket.socket,
        source: Source,
        what: str,
        failed: list[Exception],
        address: str = "127.0.0.1",
    ) -> None:
        self._listening, self._what, self._failed = listening, what, failed
        self._app = FastAPI(lifespan=self._lifespan, docs_url=None, redoc_url=None, openapi_url=None)
        self._app.add_api_websocket_route(PATH, Conversations(source).serve)
        self._background: list[Background] = []
        config = uvicorn.Config(
            self._app, log_level=logging.ERROR, ws_max_size=65536, timeout_graceful_shutdown=1
        )
        self._server = _Server(config)
        _dress(self._app)
        self._link = guard(self._app, listening, address)

    def serve(self, opens: bool, background: list[Background]) -> None:
        """Until any of `background` ends.

        Raises:
            RunError: one of them failed.
        """
        self._background = background
        tell = ask if self._link.secret else say  # without the link nobody could see the page
        tell(f"dashboard of {self._what} at {self._link.url}; Ctrl-C ends")
        if opens:
            webbrowser.open(self._link.url)
        self._server.run(sockets=[self._listening])
        if self._failed:
            error = self._failed[0]
            raise RunError(f"dashboard of {self._what}: {type(error).__name__}: {error}") from error

    @asynccontextmanager
    async def _lifespan(self, _app: FastAPI) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(self._watched(each)) for each in self._background]
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _watched(self, task: Background) -> None:
        try:
            await task()
        except Exception as error:  # noqa: BLE001 - said when the page has ended
            self._failed.append(error)
        finally:
            self._server.should_exit = True


def _dress(app: FastAPI) -> None:
    serve_files()
    ui.run_with(
        app,
        root=build,
        title="forefeel",
        dark=True,
        favicon=_ICON,
        tailwind=False,
        binding_refresh_interval=None,
        reconnect_timeout=_PATIENCE_S,
        message_history_length=0,
        show_welcome_message=False,
    )


async def _until(duration_s: float | None, failed: list[Exception]) -> None:
    """Until the duration is over or the network failed."""
    start_s = time.monotonic()
    while not failed and (  # noqa: ASYNC110 - a list
        duration_s is None or time.monotonic() - start_s < duration_s
    ):
        await asyncio.sleep(_POLL_S)
