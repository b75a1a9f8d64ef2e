"""A daemon's transport over several connections to the same other end, between which messages take turns.

TCP, and TLS above it, deliver in order: a lost packet holds back all that follows on its connection for a
round trip and more, far beyond the watchdog. Here each message goes over the next connection. While one waits
for its packet the others go on, and what it then delivers is refused as a message that was overtaken.

The end that connects opens the connections, each a Zenoh session of its own, all to the one port on which
the other end listens with a single session. A put of a connecting session reaches the other end once. A put
of the listening session would reach each of the connecting sessions, so that it goes out under a key with the
number of the connection, `forefeel.common.topics.numbered`, to which one of them subscribes. Observers, and
ends with a single connection, hear the plain key.
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Self

from forefeel.common.clock import Clock
from forefeel.common.codec import Codec
from forefeel.common.runtime.threads import in_thread
from forefeel.common.topics import EMERGENCY_STOP, Qos, crossing, numbered
from forefeel.common.transport.port import MOST_POLLED, Handler, KeyedHandler, OnFault, Poll, Put
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import MOST_CONNECTIONS, TransportSettings
from forefeel.common.transport.zenoh_bus import Publication, ZenohTransport

_REFRESH_S = 0.1
"""Interval of the search for subscribers: a connection that has lost its own loses its share for so long."""


class ParallelTransport:
    """Transport over `TransportSettings.parallel_connections` Zenoh sessions that connect, and one that
    listens.

    Args:
        connecting: the sessions that connect; with a single one it listens, too.
        listening: the session that only listens, where there is one beside several that connect.

    Attributes:
        notice: what the user must be told loudly about this transport, or empty.
    """

    codec = Codec

    def __init__(self, connecting: Sequence[ZenohTransport], listening: ZenohTransport | None) -> None:
        self._connecting = tuple(connecting)
        self._listening = () if listening is None else (listening,)
        self._plain = (self._connecting[0], *self._listening)
        self._sessions: tuple[ZenohTransport, ...] = (*self._connecting, *self._listening)
        self.notice = self._connecting[0].notice
        self._turns: list[_Turns] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._refresh, name="zenoh subscribers", daemon=True)
        self._thread.start()

    @classmethod
    def open(
        cls,
        settings: TransportSettings,
        clock: Clock,
        on_fault: OnFault,
        party: Party | None = None,
        *,
        insecure: bool = False,
        real_stage: bool = False,
    ) -> Self:
        """Opens all of the sessions, or none: `parallel_connections` that connect, and one that only listens
        where those are several and the settings listen. See `ZenohTransport.open`, also for what is raised.
        """
        count = settings.parallel_connections
        only_connects = settings.model_copy(update={"listen": ()})
        wanted = [settings] if count == 1 else [only_connects] * count
        if count > 1 and settings.listen:
            wanted.append(settings.model_copy(update={"connect": ()}))

        def opened(one: TransportSettings) -> ZenohTransport:
            return ZenohTransport.open(one, clock, on_fault, party, insecure=insecure, real_stage=real_stage)

        sessions = _all_or_none(wanted, opened)
        return cls(sessions[:count], sessions[count] if len(sessions) > count else None)

    def publisher(self, key: str, qos: Qos) -> Put:
        """Publisher of a key. Payloads of a topic that takes turns go to the next connection with a plain
        subscriber and the next with a numbered one, or to the first if there are none, and to the listening
        session. Others go to the first connection and the listening session.
        """
        topic = crossing(key)
        if topic is None or not topic.takes_turns:
            return _all_of([session.publisher(key, qos) for session in self._plain])
        publications = [session.publication(key, qos) for session in self._connecting]
        count = len(self._connecting)
        plain = _Turns(publications)
        single = _Turns(
            [
                self._connecting[number % count].publication(numbered(number, key), qos)
                for number in range(MOST_CONNECTIONS)
            ]
        )
        first = publications[0].put
        listening = [session.publisher(key, qos) for session in self._listening]
        self._turns += [plain, single]

        def put(payload: bytes) -> None:
            sent, sent_plain = single.put(payload), plain.put(payload)
            if not (sent or sent_plain):
                first(payload)  # somebody may have come since the last refresh
            for listener in listening:
                listener(payload)

        return put

    def subscribe(self, key: str, handler: Handler) -> None:
        """Subscribes `handler` on every session that receives the key; its calls never overlap."""
        serial = threading.Lock()

        def deliver(payload: bytes, receive_ns: int) -> None:
            with serial:
                handler(payload, receive_ns)

        for session, name in self._receivers(key):
            session.subscribe(name, deliver)

    def polled(self, key: str, handler: Handler, most: int = MOST_POLLED) -> Poll:
        """Subscribes without a thread; the returned poll takes from each session that receives the key its
        share of `most` payloads, at least one.
        """
        receivers = tuple(self._receivers(key))
        share = max(1, most // len(receivers))
        polls = [session.polled(name, handler, share) for session, name in receivers]
        if len(polls) == 1:
            return polls[0]

        def poll() -> None:
            for take in polls:
                take()

        return poll

    def _receivers(self, key: str) -> Iterator[tuple[ZenohTransport, str]]:
        """Yields the sessions that subscribe to a key, each with its key. Where a topic takes turns over
        several connections: each of them with its number in the key, the listening session with the plain
        key. Else, and for an emergency stop besides: first connection and listening session, with the plain
        key.
        """
        topic = crossing(key)
        plain: tuple[ZenohTransport, ...] = self._plain
        if topic is not None and topic.takes_turns and len(self._connecting) > 1:
            for number, session in enumerate(self._connecting):
                yield session, numbered(number, key)
            # A stop may come from anyone, and who only watches has a single connection.
            plain = self._plain if topic is EMERGENCY_STOP else self._listening
        for session in plain:
            yield session, key

    def subscribe_all(self, prefix: str, handler: KeyedHandler) -> None:
        """Calls `handler` for each payload put by others to `prefix` or below it that comes to the first
        connection or the listening session, as often as it comes; the others are not asked. Calls never
        overlap.
        """
        serial = threading.Lock()

        def deliver(key: str, payload: bytes, receive_ns: int) -> None:
            with serial:
                handler(key, payload, receive_ns)

        for session in self._plain:
            session.subscribe_all(prefix, deliver)

    def peers(self) -> int:
        """Number of other sessions that are connected now to that session which has most of them."""
        return max(session.peers() for session in self._sessions)

    @property
    def hint(self) -> str:
        """Text on a router in the way of the first connection, see `ZenohTransport.hint`; else empty."""
        return self._connecting[0].hint

    def close(self) -> None:
        """Ends the thread and closes all sessions; the first one last, whose events are the latest."""
        self._closing.set()
        self._thread.join()
        for session in reversed(self._sessions):
            session.close()

    def _refresh(self) -> None:
        while not self._closing.wait(_REFRESH_S):
            for turns in tuple(self._turns):
                turns.refresh()


class _Turns:
    """Sends each message over the next publication that had a subscriber at the last `refresh`."""

    def __init__(self, publications: Sequence[Publication]) -> None:
        self._publications = publications
        self._next = 0
        self._subscribed: tuple[Put, ...] = ()

    def refresh(self) -> None:
        self._subscribed = tuple(p.put for p in self._publications if p.has_subscriber())

    def put(self, payload: bytes) -> bool:
        """Sends over the next publication with a subscriber; False, and not sent, without any."""
        subscribed = self._subscribed
        if subscribed:
            self._next += 1
            subscribed[self._next % len(subscribed)](payload)
        return bool(subscribed)


def _all_of(puts: Sequence[Put]) -> Put:
    """One `Put` that calls all of them."""
    if len(puts) == 1:
        return puts[0]

    def put(payload: bytes) -> None:
        for one in puts:
            one(payload)

    return put


def _all_or_none(
    wanted: Sequence[TransportSettings], opened: Callable[[TransportSettings], ZenohTransport]
) -> list[ZenohTransport]:
    """Opens all sessions at once, for each may wait for a router; returns them in order. Where one fails,
    closes the others and raises its error.
    """
    with ExitStack() as opened_sessions:
        opening = [in_thread(partial(opened, one), "zenoh open") for one in wanted]
        for future in opening:
            if future.exception() is None:
                opened_sessions.callback(future.result().close)
        sessions = [future.result() for future in opening]
        opened_sessions.pop_all()
    return sessions
