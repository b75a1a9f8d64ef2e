"""Who may see the page: raw requests and WebSocket handshakes to the real server."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import NamedTuple

import pytest

pytest.importorskip("nicegui")

from tests.live_cell import Process, free_port
from tests.unit.dashboard.test_replay import write
from tests.waiting import wait_until

LIVE, SOCKET_IO = "/conversation", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
HANDSHAKE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",  # of RFC 6455
}
_START_S = 60.0
_ANSWER_S = 20.0


class Answer(NamedTuple):
    status: int
    headers: dict[str, str]
    text: str


class Asked:
    """A server of the page. `host`: it answers to this name and port."""

    def __init__(self, port: int, link: str) -> None:
        self.port, self.link, self.host = port, link, f"127.0.0.1:{port}"

    def get(self, path: str = "/", **headers: str) -> Answer:
        """`Host` is the right one where none is given."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=_ANSWER_S)
        try:
            connection.request("GET", path, headers={"Host": self.host, **headers})
            answer = connection.getresponse()
            text = "" if answer.status == 101 else answer.read().decode()
            return Answer(answer.status, {k.lower(): v for k, v in answer.getheaders()}, text)
        finally:
            connection.close()

    def handshake(self, path: str = LIVE, **headers: str) -> int:
        """Its status; 101: the WebSocket is open."""
        return self.get(path, **HANDSHAKE, **headers).status

    @property
    def token(self) -> str:
        return self.link.partition("?token=")[2]


@contextmanager
def serving(folder: Path, *words: str) -> Iterator[Asked]:
    """`forefeel view` of a recording, and the link that it says."""
    port = free_port()
    recording = str(write(folder / "run.mcap", 2))
    process = Process("view", folder, "view", recording, "--port", str(port), *words)
    link = re.compile(r" at (http://\S+); Ctrl-C")
    try:
        wait_until(lambda: link.search(process.log.read_text()), _START_S, "the link")
        yield Asked(port, link.findall(process.log.read_text())[0])
    finally:
        process.kill()


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Asked]:
    """At loopback."""
    with serving(tmp_path_factory.mktemp("own")) as found:
        yield found


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Asked]:
    """At every address of this host, and quiet."""
    with serving(tmp_path_factory.mktemp("wide"), "--address", "0.0.0.0", "--quiet") as found:
        yield found


@pytest.mark.parametrize("path", [LIVE, SOCKET_IO])
def test_its_own_page_is_served(own: Asked, path: str) -> None:
    assert own.link == f"http://{own.host}/"
    assert "forefeel" in own.get().text
    assert own.handshake(path) == 101
    assert own.handshake(path, Origin=f"http://{own.host}") == 101
    for name in ("localhost", "[::1]"):
        at = f"{name}:9000"  # through `ssh -L 9000:...`
        assert own.get(Host=at).status == 200
        assert own.handshake(path, Host=at, Origin=f"http://{at}") == 101


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "192.0.2.7", ""]
)
def test_a_name_that_was_pointed_at_this_host_is_refused(own: Asked, host: str) -> None:
    host = host.format(port=own.port)
    assert own.get(Host=host).status == 400
    assert own.get("/forefeel/page.js", Host=host).status == 400
    for path in (LIVE, SOCKET_IO):
        assert own.handshake(path, Host=host) == 400
        assert own.handshake(path, Host=host, Origin=f"http://{host}") == 400


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "", "http://127.0.0.1:1", "http://[", "http://localhost:{port}"],
)
def test_what_a_page_of_another_site_asks_is_refused(own: Asked, origin: str) -> None:
    origin = origin.format(port=own.port)
    answer = own.get(Origin=origin)
    assert (answer.status, answer.text) == (403, "Refused: a page of another site asked (Origin).\n")
    assert "access-control-allow-origin" not in answer.headers
    for path in (LIVE, SOCKET_IO, SOCKET_IO.replace("websocket", "polling")):
        assert own.handshake(path, Origin=origin) == 403


def test_beyond_loopback_nobody_sees_anything_without_the_token(wide: Asked) -> None:
    assert len(wide.token) >= 43  # 32 bytes
    for cookie in ("", "wrong", wide.token[:-1], f"{wide.token}0", "\xe4"):
        headers = {"Cookie": f"forefeel-{wide.port}={cookie}"} if cookie else {}
        for path in ("/", "/?token=", "/?token=wrong", "/?token=%C3%A4", "/forefeel/page.js", "/nothing"):
            answer = wide.get(path, **headers)
            assert (answer.status, answer.text.count("\n")) == (401, 1)
            assert "open the link that the dashboard's terminal shows" in answer.text
        assert [wide.handshake(path, **headers) for path in (LIVE, SOCKET_IO)] == [401, 401]


def test_the_token_of_the_link_becomes_a_cookie(wide: Asked) -> None:
    answer = wide.get(f"/?token={wide.token}")
    assert (answer.status, answer.headers["location"]) == (303, "/")
    cookie, *attributes = answer.headers["set-cookie"].split("; ")
    assert cookie == f"forefeel-{wide.port}={wide.token}"
    assert {"HttpOnly", "Path=/", "SameSite=strict"} <= set(attributes)
    page = wide.get(Cookie=cookie)
    assert page.status == 200
    assert wide.token not in page.text
    for path in (LIVE, SOCKET_IO):
        assert wide.handshake(path, Cookie=cookie, Origin=f"http://{wide.host}") == 101
        assert wide.handshake(path, Cookie=cookie, Origin="http://evil.example") == 403
        assert wide.handshake(path, Cookie=cookie, Host="evil.example") == 400


def test_each_start_has_another_token(wide: Asked, tmp_path: Path) -> None:
    with serving(tmp_path, "--address", "0.0.0.0") as other:
        assert other.token != wide.token
        assert other.get(f"/?token={wide.token}").status == 401
