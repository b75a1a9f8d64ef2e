"""The typed bus: messages of the topic table over any transport, stamped and numbered on the way out, checked
on the way in.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from itertools import count as numbers
from typing import TypedDict, TypeVar

from forefeel.common.clock import Clock
from forefeel.common.codec import decode, encode
from forefeel.common.errors import CodecError
from forefeel.common.flight import FlightRing, Rings
from forefeel.common.messages import Message
from forefeel.common.topics import Topic
from forefeel.common.transport.port import Put, Transport

M = TypeVar("M", bound=Message)


class Header(TypedDict):
    """The fields that every message carries, beside the protocol version."""

    session_id: int
    sequence: int
    stamp_ns: int


class Publisher:
    """Publishes one topic of one axis. Stamps and numbers are given by `header`, so that a message is built
    once.
    """

    def __init__(self, put: Put) -> None:
        self._put = put
        self._sequence = numbers(1)

    def header(self, session_id: int, now_ns: int) -> Header:
        """The fields that every message carries, with the next sequence number of this publisher."""
        return {"session_id": session_id, "sequence": next(self._sequence), "stamp_ns": now_ns}

    def send(self, message: Message) -> None:
        self._put(encode(message))


class Bus:
    """One axis of one cell on a transport.

    Args:
        rings: of the flight recorder, which get each payload, in and out, as `(stamp_ns, payload)`.

    Attributes:
        malformed: payloads refused by the codec, by topic name.
        counters: what else is counted about this connection.
    """

    def __init__(
        self, transport: Transport, cell: str, axis: str, clock: Clock, rings: Rings | None = None
    ) -> None:
        self._transport = transport
        self._rings = rings
        self._cell, self._axis = cell, axis
        self._clock = clock
        self.malformed: Counter[str] = Counter()
        self.counters: Counter[str] = Counter()

    def publisher(self, topic: Topic[Message]) -> Publisher:
        assert topic.published, topic.name
        key = topic.key(self._cell, self._axis)
        put = self._transport.publisher(key, topic.qos)
        return Publisher(put if self._rings is None else self._recorded(put, self._rings.ring(key)))

    def _recorded(self, put: Put, ring: FlightRing) -> Put:
        add, now_ns = ring.add, self._clock.now_ns

        def send(payload: bytes) -> None:
            add((now_ns(), payload))
            put(payload)

        return send

    def subscribe(
        self,
        topic: Topic[M],
        handler: Callable[[M, int], None],
        on_malformed: Callable[[], None] | None = None,
    ) -> None:
        """Calls `handler(message, receive_ns)` for each well-formed message; others are counted, and
        `on_malformed` is called.
        """
        kind, name, malformed = topic.message, topic.name, self.malformed
        key = topic.key(self._cell, self._axis)
        received = None if self._rings is None else self._rings.ring(key).received

        def receive(payload: bytes, receive_ns: int) -> None:
            if received is not None:
                received(payload, receive_ns)
            try:
                message = decode(kind, payload)
            except CodecError:
                malformed[name] += 1
                if on_malformed is not None:
                    on_malformed()
                return
            handler(message, receive_ns)

        self._transport.subscribe(key, receive)

    @property
    def refused(self) -> Mapping[str, int]:
        return self._transport.refused()

    def counts(self) -> dict[str, int]:
        counted = list(self.malformed.items())  # at once: the transport's threads go on counting
        malformed = {f"malformed_{name.replace('/', '_')}": n for name, n in counted}
        return {**self.counters, **self.refused, **malformed}
