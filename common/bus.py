"""The typed bus: messages of the topic table over any transport, stamped and numbered on the way out, checked
on the way in.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import count as numbers
from typing import TypedDict, TypeVar

from forefeel.common.clock import Clock
from forefeel.common.codec import Codec
from forefeel.common.errors import CodecError
from forefeel.common.flight import Rings
from forefeel.common.messages import Message
from forefeel.common.topics import Qos, Topic
from forefeel.common.transport.port import Handler, Poll, Put, Transport

M = TypeVar("M", bound=Message)
_MOST_BATCHED_NS = 1_000_000_000  # ns between the first and the last of a batch, whatever a stamp says


class Header(TypedDict):
    """The fields that every message carries, beside the protocol version."""

    session_id: int
    sequence: int
    stamp_ns: int


BATCH_NS = 20_000_000
"""ns of a 1 kHz topic that observers hear at once; with what a recorder waits a kill loses at most 50 ms."""


class Publisher:
    """Publishes one topic of one axis; `header` gives stamp and number, so that a message is built once."""

    def __init__(self, codec: type[Codec], puts: Sequence[Put]) -> None:
        self._encode, self._puts = codec.encode, puts
        self._sequence = numbers(1)

    def header(self, session_id: int, now_ns: int) -> Header:
        """The fields that every message carries, with the next sequence number of this publisher."""
        return {"session_id": session_id, "sequence": next(self._sequence), "stamp_ns": now_ns}

    def send(self, message: Message) -> None:
        payload = self._encode(message)
        for put in self._puts:
            put(payload)


def observed(
    topic: Topic[M],
    payload: bytes,
    receive_ns: int,
    codec: type[Codec] = Codec,
    step: int = 1,
    first: int = 0,
) -> list[tuple[M, int]]:
    """Decodes what an observer receives under the key of a topic: one message, or those of a batch that
    `step` and `first` pick (see `decode_batch`). Returns each with its receive stamp: `receive_ns` for the
    newest, for others as much earlier as their stamps are, at most 1 s.

    Raises:
        CodecError: the bytes are no such message or batch.
    """
    if not topic.batched:
        return [(codec.decode(topic.message, payload), receive_ns)]
    messages = codec.decode_batch(topic.message, payload, step, first)
    last_ns = max((message.stamp_ns for message in messages), default=0)
    return [(message, receive_ns - min(last_ns - message.stamp_ns, _MOST_BATCHED_NS)) for message in messages]


class Bus:
    """Publishes and subscribes the topics of one axis of one cell over a transport.

    Args:
        rings: of the flight recorder, which get each payload, in and out, as `(stamp_ns, payload)`.

    Attributes:
        malformed: payloads refused by the codec, by topic name.
    """

    def __init__(
        self, transport: Transport, cell: str, axis: str, clock: Clock, rings: Rings | None = None
    ) -> None:
        self._transport, self._codec = transport, transport.codec
        self._rings = rings
        self._cell, self._axis = cell, axis
        self._clock = clock
        self._batches: list[tuple[list[bytes], Put]] = []
        self._batched_ns = 0
        self.malformed: Counter[str] = Counter()

    def publisher(self, topic: Topic[Message]) -> Publisher:
        """Makes the publisher of a topic (asserts `topic.published`). It sends each message at once; of a
        batched topic into a batch for observers, which `end_batches` sends, and at once too if the topic
        crosses to the other end. Payloads also go into the flight ring, if there is one.
        """
        assert topic.published, topic.name
        key = topic.key(self._cell, self._axis)
        puts: list[Put] = []
        if self._rings is not None:
            add, now_ns = self._rings.ring(key).add, self._clock.now_ns
            puts.append(lambda payload: add((now_ns(), payload)))
        if topic.batched:
            batch: list[bytes] = []
            self._batches.append((batch, self._transport.publisher(key, Qos.STATE)))
            puts.append(batch.append)
        if topic.crosses or not topic.batched:
            taken = topic.taken_key(self._cell, self._axis)
            puts.insert(0, self._transport.publisher(taken, topic.qos))
        return Publisher(self._codec, puts)

    def end_batches(self, now_ns: int, last: bool = False) -> None:
        """Sends and empties the batches for observers if 20 ms have passed since it last did, or with `last`;
        else does nothing. Called at each tick.
        """
        if now_ns - self._batched_ns < BATCH_NS and not last:
            return
        self._batched_ns = now_ns
        for batch, put in self._batches:
            if batch:
                payload = self._codec.encode_batch(batch)
                batch.clear()
                put(payload)

    def subscribe(
        self,
        topic: Topic[M],
        handler: Callable[[M, int], None],
        on_malformed: Callable[[], None] | None = None,
    ) -> None:
        """Subscribes `handler(message, receive_ns)`, called by the transport's thread for each message. A
        payload that is no message is counted in `malformed` and calls `on_malformed`.
        """
        self._transport.subscribe(*self._receiver(topic, handler, on_malformed))

    def polled(self, topic: Topic[M], handler: Callable[[M, int], None]) -> Poll:
        """Subscribes without a thread; the returned function calls `handler(message, receive_ns)` for each
        message that waits, in the order of their sequence numbers. Malformed payloads are counted.
        """
        waiting: list[tuple[M, int]] = []
        take = self._transport.polled(
            *self._receiver(topic, lambda message, receive_ns: waiting.append((message, receive_ns)))
        )

        def poll() -> None:
            """Decodes what waits and calls `handler` for each message, by sequence number."""
            take()
            if len(waiting) > 1:
                waiting.sort(key=_sequence)
            for message, receive_ns in waiting:
                handler(message, receive_ns)
            waiting.clear()

        return poll

    def _receiver(
        self,
        topic: Topic[M],
        handler: Callable[[M, int], None],
        on_malformed: Callable[[], None] | None = None,
    ) -> tuple[str, Handler]:
        """Key to subscribe to, and a payload handler that decodes for `handler(message, receive_ns)`. A
        payload that is no message is counted in `malformed` and calls `on_malformed`. Each payload also goes
        into the flight ring, if there is one.
        """
        kind, name, malformed, decode = topic.message, topic.name, self.malformed, self._codec.decode
        key = topic.key(self._cell, self._axis)
        received = None if self._rings is None else self._rings.ring(key).received

        def receive(payload: bytes, receive_ns: int) -> None:
            """Adds a payload to the flight ring, decodes it for `handler`; counts and reports a bad one."""
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

        return topic.taken_key(self._cell, self._axis), receive

    def counts(self) -> dict[str, int]:
        counted = list(self.malformed.items())  # at once: the transport's threads go on counting
        return {f"malformed_{name.replace('/', '_')}": n for name, n in counted}


def _sequence(received: tuple[Message, int]) -> int:
    return received[0].sequence
