"""Who may see the page: requests and WebSocket handshakes to the guarded application, as ASGI has them."""

import asyncio
import re
import socket
from collections.abc import Iterator
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import pytest

pytest.importorskip("starlette")
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from forefeel.dashboard.admission import guard

LIVE = "/conversation"


class Answer(NamedTuple):
    """`status` 101: the WebSocket is open."""

    status: int
    headers: dict[str, str]
    text: str


class Guarded:
    """A page behind its checks. `link`: where it says that it is; `host`: the name and port it answers to."""

    def __init__(self, listening: socket.socket, address: str) -> None:
        self.port = listening.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        self._app = Starlette(routes=[Route("/", self._page), WebSocketRoute(LIVE, self._accept)])
        self.link = guard(self._app, listening, address).url

    @property
    def token(self) -> str:
        return self.link.partition("?token=")[2]

    def get(self, path: str = "/", kind: str = "http", **headers: str) -> Answer:
        """`Host` is the right one where none is given."""
        split = urlsplit(path)
        named = {"host": self.host, **{name.lower(): text for name, text in headers.items()}}
        scope = {
            "type": kind, "method": "GET", "path": split.path, "raw_path": split.path.encode(),
            "query_string": split.query.encode(), "scheme": "http", "subprotocols": [],
            "headers": [(name.encode(), text.encode("latin-1")) for name, text in named.items()],
            "extensions": {"websocket.http.response": {}},
        }  # fmt: skip
        sent: list[dict[str, Any]] = []

        async def receive() -> dict[str, Any]:
            return {"type": "websocket.connect" if kind == "websocket" else "http.request"}

        async def send(message: Any) -> None:  # noqa: ANN401 - ASGI's own
            sent.append(message)

        asyncio.run(self._app(scope, receive, send))
        if sent[0]["type"] == "websocket.accept":
            return Answer(101, {}, "")
        text = b"".join(message.get("body", b"") for message in sent[1:]).decode()
        return Answer(sent[0]["status"], {k.decode(): v.decode() for k, v in sent[0]["headers"]}, text)

    def handshake(self, **headers: str) -> int:
        return self.get(LIVE, "websocket", **headers).status

    @staticmethod
    async def _page(_asked: Request) -> PlainTextResponse:
        return PlainTextResponse("forefeel")

    @staticmethod
    async def _accept(asked: WebSocket) -> None:
        await asked.accept()


@pytest.fixture
def own() -> Iterator[Guarded]:
    """At loopback."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield Guarded(listening, "127.0.0.1")


@pytest.fixture
def wide() -> Iterator[Guarded]:
    """At every address of this host."""
    with socket.create_server(("0.0.0.0", 0)) as listening:
        yield Guarded(listening, "0.0.0.0")


def test_admission_own_page_is_served(own: Guarded) -> None:
    assert own.link == f"http://{own.host}/"
    assert own.get().text == "forefeel"
    assert own.handshake() == own.handshake(Origin=f"http://{own.host}") == 101
    for name in ("localhost", "[::1]"):
        at = f"{name}:9000"  # through `ssh -L 9000:...`
        assert own.get(Host=at).status == 200
        assert own.handshake(Host=at, Origin=f"http://{at}") == 101


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "192.0.2.7", ""]
)
def test_admission_foreign_host_name_is_refused(own: Guarded, host: str) -> None:
    host = host.format(port=own.port)
    assert own.get(Host=host).status == 400
    assert own.handshake(Host=host) == own.handshake(Host=host, Origin=f"http://{host}") == 400


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "", "http://127.0.0.1:1", "http://[", "http://localhost:{port}"],
)
def test_admission_foreign_origin_is_refused(own: Guarded, origin: str) -> None:
    answer = own.get(Origin=origin.format(port=own.port))
    assert answer.status == 403
    assert "access-control-allow-origin" not in answer.headers
    assert own.handshake(Origin=origin.format(port=own.port)) == 403


def test_admission_beyond_loopback_needs_token(wide: Guarded) -> None:
    assert len(wide.token) >= 43  # 32 bytes
    with socket.create_server(("0.0.0.0", 0)) as again:
        assert Guarded(again, "0.0.0.0").token != wide.token
    for cookie in ("", "wrong", wide.token[:-1], f"{wide.token}0", "\xe4"):
        headers = {"Cookie": f"forefeel-{wide.port}={cookie}"} if cookie else {}
        for path in ("/", "/?token=", "/?token=wrong", "/?token=%C3%A4", "/nothing"):
            assert wide.get(path, **headers).status == 401
        assert wide.handshake(**headers) == 401


def test_admission_token_becomes_cookie(wide: Guarded) -> None:
    answer = wide.get(f"/?token={wide.token}")
    assert (answer.status, answer.headers["location"]) == (303, "/")
    cookie, *attributes = re.split("; *", answer.headers["set-cookie"])
    assert cookie == f"forefeel-{wide.port}={wide.token}"
    assert {"HttpOnly", "Path=/", "SameSite=strict"} <= set(attributes)
    assert wide.get(Cookie=cookie).text == "forefeel"
    assert wide.handshake(Cookie=cookie, Origin=f"http://{wide.host}") == 101
    assert wide.handshake(Cookie=cookie, Origin="http://evil.example") == 403
    assert wide.handshake(Cookie=cookie, Host="evil.example") == 400
