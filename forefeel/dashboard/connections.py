"""Bounded connections of the page: those that ask nothing keep nobody from the stop button.

A connection is silent until the head of its request is complete, and again once that is answered. A
WebSocket is none of these any more: `Story` bounds them.
"""

import asyncio
import math
from collections.abc import Collection
from operator import attrgetter

from uvicorn.protocols.http.h11_impl import H11Protocol

from forefeel.terminal import say

MOST_CONNECTIONS = 512  # of the 1024 files that most hosts allow a process; 16 browsers open at most 96
HEAD_S = 10.0  # s that a request may take to arrive
_NOTICE_S = 60.0  # s between two lines about connections that gave way


class Connection(H11Protocol):
    """HTTP connection of uvicorn that gives way. A WebSocket that it becomes is ended by `state.abort`."""

    _noticed_s = -math.inf  # by the class, for all connections
    since_s: float  # when it connected, or was last answered

    @property
    def silent(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
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
    """The one that gives way to a new one: the oldest silent one, or else the oldest. None: there is room."""
    if len(peers) < MOST_CONNECTIONS:
        return None
    return min([peer for peer in peers if peer.silent] or peers, key=attrgetter("since_s"))


def overdue(peers: Collection[Connection], now_s: float) -> list[Connection]:
    """Those whose request does not arrive in time."""
    return [peer for peer in peers if peer.silent and now_s - peer.since_s > HEAD_S]
