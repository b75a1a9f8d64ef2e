"""The transport port: what the daemons need of a network, and nothing more."""

from collections.abc import Callable
from typing import Protocol

from forefeel.common.codec import Codec
from forefeel.common.topics import Qos

Handler = Callable[[bytes, int], None]
"""Called with (payload, receive stamp in ns of the local monotonic clock), on a thread of the transport.

A handler decodes, gates and hands over (slot or bounded queue). It never blocks, and never puts or closes.
"""

KeyedHandler = Callable[[str, bytes, int], None]
"""Like `Handler`, with the key in front: for who subscribes to many keys at once, as the recorder does."""

Put = Callable[[bytes], None]
"""Sends one payload and returns at once; after a millisecond at most where the network is congested.

Does nothing after `close`.
"""

Poll = Callable[[], None]
"""Hands over what waits, oldest first, on the calling thread; at most so many payloads as was agreed."""
MOST_POLLED = 32
"""A tick of 1 ms takes so many of a backlog or a flood: some 0.2 ms. The link brings one."""

OnFault = Callable[[Exception], None]
"""Takes an exception that reached the edge of one of our threads to the safety state; never raises."""


class Transport(Protocol):
    """Delivers payloads to the subscribers of the same key, or loses them; never blocks a STREAM publisher.

    Never delivers to the session that put. `codec`: what its payloads are.
    """

    @property
    def codec(self) -> type[Codec]: ...

    def publisher(self, key: str, qos: Qos) -> Put:
        """Declares a publisher once; its `Put` is then cheap to call."""
        ...

    def subscribe(self, key: str, handler: Handler) -> None:
        """Calls `handler` for each payload put to `key` by another session."""
        ...

    def polled(self, key: str, handler: Handler, most: int = MOST_POLLED) -> Poll:
        """Like `subscribe`, without a thread: `handler` is called by what is returned, for a fixed-rate loop
        that takes what has come since its last tick; at most `most` payloads at once.
        """
        ...

    def subscribe_all(self, prefix: str, handler: KeyedHandler) -> None:
        """Calls `handler` for each payload put by another session to `prefix` or to any key below it."""
        ...

    def peers(self) -> int:
        """Number of other sessions connected now; 0 while the other end is waited for."""
        ...

    def close(self) -> None:
        """Undeclares everything and ends every thread; idempotent. Nothing is delivered afterwards."""
        ...


class Timers(Protocol):
    """Calls a function at a stamp of the local clock: all that the impairment needs of a scheduler."""

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        """Runs `action` at `due_ns` or as soon after as possible; actions of equal stamp keep their order."""
        ...
