"""Admission to the page: checks on every request and every WebSocket handshake."""

import secrets
import socket
from ipaddress import ip_address
from typing import NamedTuple

import ifaddr
from starlette.applications import Starlette
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

_TOKEN_BYTES = 32  # bytes of randomness, 256 bits, as Python's `secrets` holds sufficient against guessing
_OF_LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
_FOREIGN = "Refused: a page of another site asked (Origin).\n"
_NO_TOKEN = "Not allowed without the token: open the link that the dashboard's terminal shows.\n"


class Admission:
    """ASGI middleware: refuses requests from pages of other sites, and requests without the token.

    A browser lets the pages of any site ask here, and lets them read the answers of a WebSocket.

    Args:
        token: comes with the query of the first visit, then with the cookie; None: nobody needs it.
        cookie: the cookie's name.
    """

    def __init__(self, app: ASGIApp, token: str | None, cookie: str) -> None:
        self._app, self._token, self._cookie = app, token, cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        answer = self._app if scope["type"] == "lifespan" else self._application_for(HTTPConnection(scope))
        await answer(scope, receive, send)

    def _application_for(self, asked: HTTPConnection) -> ASGIApp:
        """Chooses what answers a request: the page's own application where it is admitted, else a response:
        403 to a page of another site, 401 without a right token or cookie; a right token in the query sets
        the cookie and redirects. Where no token is asked for, only the site is checked.
        """
        origin = asked.headers.get("origin")
        if origin is not None and origin.partition("://")[2] != asked.headers["host"]:
            return PlainTextResponse(_FOREIGN, 403)
        if self._token is None:
            return self._app
        if _same(asked.query_params.get("token"), self._token):
            return self._admitted(self._token)
        known = _same(asked.cookies.get(self._cookie), self._token)
        return self._app if known else PlainTextResponse(_NO_TOKEN, 401)

    def _admitted(self, token: str) -> RedirectResponse:
        """Sets the cookie and redirects to the address without the token, where others could read it."""
        answer = RedirectResponse("/", 303, {"Cache-Control": "no-store"})
        answer.set_cookie(self._cookie, token, httponly=True, samesite="strict")
        return answer


class PageAddress(NamedTuple):
    """URL of the page; `secret`: it holds the token."""

    url: str
    secret: bool


def guard(app: Starlette, listening: socket.socket, address: str) -> PageAddress:
    """Adds middleware to `app` that checks host name, origin and, beyond loopback, a new token; returns the
    link to the page, with that token in it.

    Args:
        address: as it was asked for, maybe a name; the page is also reached by it.
    """
    bound, port = listening.getsockname()[:2]
    bound_ip = ip_address(bound)
    token = None if bound_ip.is_loopback else secrets.token_urlsafe(_TOKEN_BYTES)
    # cookies are shared by all ports of a host: two dashboards do not take each other's
    app.add_middleware(Admission, token=token, cookie=f"forefeel-{port}")
    hosts = [*_OF_LOOPBACK, _in_url(bound), _in_url(address), *([] if token is None else _names())]
    # added last, it is asked first: a name that somebody else has pointed at this host (DNS rebinding)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)
    url = f"http://{socket.gethostname() if bound_ip.is_unspecified else _in_url(bound)}:{port}/"
    return PageAddress(url if token is None else f"{url}?token={token}", token is not None)


def _same(given: str | None, token: str) -> bool:
    """Compares in constant time."""
    return secrets.compare_digest((given or "").encode(), token.encode())


def _in_url(address: str) -> str:
    return f"[{address}]" if ":" in address else address


def _names() -> list[str]:
    addresses = (entry.ip for adapter in ifaddr.get_adapters() for entry in adapter.ips)
    numbers = [_in_url(ip if isinstance(ip, str) else ip[0]) for ip in addresses]
    return [socket.gethostname(), socket.getfqdn(), *numbers]
