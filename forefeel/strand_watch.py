"""Says when some of the connections of a transport are missing while the other end is there."""

from collections.abc import Callable
from typing import Protocol

PERIOD_NS = 2_000_000_000
"""Longer than connections that come up together are apart."""


class Connections(Protocol):
    """Whoever knows what is wrong with the connections."""

    @property
    def amiss(self) -> str:
        """In words, or empty."""
        ...


class StrandWatch:
    """Says what lasts from one look to the next, once each time; `say` takes a line."""

    def __init__(self, transport: Connections, say: Callable[[str], None]) -> None:
        self._transport = transport
        self._say = say
        self._seen = self._said = ""

    def look(self, now_ns: int) -> None:
        """Once a period."""
        del now_ns
        amiss = self._transport.amiss
        if amiss == self._seen != self._said:
            self._said = amiss
            self._say(f"link: {amiss or 'all connections stand again'}")
        self._seen = amiss
