"""The transport within one process, synchronous and in order: it carries the simulation in virtual time."""

from collections import deque
from collections.abc import Callable

from forefeel.common.clock import Clock
from forefeel.common.codec import Codec
from forefeel.common.topics import Qos
from forefeel.common.transport.port import MOST_POLLED, Handler, KeyedHandler, Poll, Put


class MemoryBus:
    """Joins sessions: a payload put by one is delivered at once to the matching subscribers of all others.

    For one thread. An exception of a handler reaches whoever called `put`: a simulation stops there.

    Args:
        codec: `Objects` where nobody needs the bytes, which is quicker.
    """

    def __init__(self, codec: type[Codec] = Codec) -> None:
        self.codec = codec
        self._sessions: list[MemoryTransport] = []

    def session(self, clock: Clock) -> "MemoryTransport":
        """A new session; its handlers get receive stamps of `clock`."""
        session = MemoryTransport(self, clock)
        self._sessions.append(session)
        return session

    def _others(self, session: "MemoryTransport") -> list["MemoryTransport"]:
        return [other for other in self._sessions if other is not session]

    def _resolve(self) -> None:
        """Sets the targets of each publication: the subscriptions of other sessions that match its key."""
        for session in self._sessions:
            for publication in session.publications:
                publication.targets = tuple(
                    subscription
                    for other in self._others(session)
                    for subscription in other.subscriptions
                    if subscription.matches(publication.key)
                )


class MemoryTransport:
    """One session on a `MemoryBus`. See the port for the contract."""

    def __init__(self, bus: MemoryBus, clock: Clock) -> None:
        self._bus, self.codec = bus, bus.codec
        self._now_ns = clock.now_ns
        self._closed = False
        self.publications: list[_Publication] = []
        self.subscriptions: list[_Subscription] = []

    def publisher(self, key: str, qos: Qos) -> Put:
        del qos
        publication = _Publication(key)
        self.publications.append(publication)
        self._bus._resolve()
        return publication.put

    def subscribe(self, key: str, handler: Handler) -> None:
        self._add(_Subscription(key, None, lambda _key, payload: handler(payload, self._now_ns())))

    def polled(self, key: str, handler: Handler, most: int = MOST_POLLED) -> Poll:
        """Subscribes; the returned function hands what came to `handler`, oldest first, up to `most`."""
        waiting: deque[tuple[bytes, int]] = deque()
        self.subscribe(key, lambda payload, receive_ns: waiting.append((payload, receive_ns)))

        def poll() -> None:
            for _ in range(min(len(waiting), most)):
                handler(*waiting.popleft())

        return poll

    def subscribe_all(self, prefix: str, handler: KeyedHandler) -> None:
        self._add(
            _Subscription(prefix, prefix + "/", lambda key, payload: handler(key, payload, self._now_ns()))
        )

    def peers(self) -> int:
        return 0 if self._closed else len(self._bus._others(self))

    def close(self) -> None:
        """Ends all delivery to and from the session; idempotent."""
        if self._closed:
            return
        self._closed = True
        for subscription in self.subscriptions:
            subscription.deliver = _ignore
        for publication in self.publications:
            publication.targets = ()
        self._bus._sessions.remove(self)
        self._bus._resolve()

    def _add(self, subscription: "_Subscription") -> None:
        self.subscriptions.append(subscription)
        self._bus._resolve()


class _Subscription:
    """Listener to `key`, and with a prefix to all that starts with it."""

    def __init__(self, key: str, prefix: str | None, deliver: Callable[[str, bytes], None]) -> None:
        self._key, self._prefix = key, prefix
        self.deliver = deliver

    def matches(self, key: str) -> bool:
        return key == self._key or (self._prefix is not None and key.startswith(self._prefix))


class _Publication:
    """One publisher and the subscriptions that its payloads go to."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.targets: tuple[_Subscription, ...] = ()

    def put(self, payload: bytes) -> None:
        for target in self.targets:
            target.deliver(self.key, payload)


def _ignore(_key: str, _payload: bytes) -> None:
    """Drops a payload that is on its way to a closed session."""
