"""The transport port: what the daemons need of a network, and nothing more."""

from collections.abc import Callable
from typing import Protocol

from common.topics import Qos

Handler = Callable[[bytes, int], None]
"""Called with (payload, receive stamp in ns of the local monotonic clock), on a thread that is not ours.

A handler decodes, gates and hands over (slot or bounded queue); it never blocks and never calls the transport."""

Put = Callable[[bytes], None]
"""Sends one payload; returns at once (STREAM, STATE) or after a bounded wait (EVENT)."""


class Transport(Protocol):
    """Delivers payloads to the subscribers of the same key, or loses them; never blocks a STREAM publisher."""

    def publisher(self, key: str, qos: Qos) -> Put:
        """Declares a publisher once; its `Put` is then cheap to call."""
        ...

    def subscribe(self, key: str, handler: Handler) -> None:
        """Calls `handler` for each payload put to `key` by another session."""
        ...

    def close(self) -> None:
        """Undeclares everything and ends every thread of the transport; idempotent."""
        ...


class Timers(Protocol):
    """Calls a function at a stamp of the local monotonic clock: the only thing that the impairment needs of a scheduler."""

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        """Runs `action` at `due_ns` or as soon after as possible; actions of equal stamp keep their order."""
        ...
