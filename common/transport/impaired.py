"""Puts an impairment between a daemon and any transport, and records what it did to each message."""

import heapq
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import NamedTuple

from forefeel.common.clock import Clock
from forefeel.common.settings import TICK_NS
from forefeel.common.topics import Qos, crossing, parse_key
from forefeel.common.transport.impairment import ImpairedLink
from forefeel.common.transport.port import (
    MOST_POLLED,
    Handler,
    KeyedHandler,
    Poll,
    Put,
    Timers,
    Transport,
)

# messages of a link until the trace is drained, which is ten times a second: 65 s at 1 kHz
_TRACE_CAPACITY = 65_536
_CHUNK_MESSAGES = 1024  # messages in one `ImpairmentTrace`, which holds no more (`most_items`)


class TraceChunk(NamedTuple):
    """Delays in ns of consecutive messages of one link, from index `first_index` on; none: lost."""

    link: str
    first_index: int
    delays_ns: tuple[tuple[int, ...], ...]


def crosses(key: str) -> bool:
    """True if messages of a key are impaired: the other end takes them, or they are no topic's."""
    return parse_key(key) is None or crossing(key) is not None


class ImpairedTransport:
    """Wraps a transport so that an `ImpairedLink` of each direction loses, delays and doubles its payloads.

    One state per direction, for all keys that cross to the other end. Outbound payloads are put late, inbound
    ones are handed over late and stamped then: on the timers' thread, or where they are polled at the poll
    next to that stamp, a little before or after it. A direction whose link is None costs nothing.

    A recorder has a session of its own and records what is put: outbound impairment before it, inbound
    impairment not at all. So inject inbound where the recording shall hold everything that was sent.
    """

    def __init__(
        self,
        inner: Transport,
        timers: Timers,
        clock: Clock,
        inbound: ImpairedLink | None,
        outbound: ImpairedLink | None,
    ) -> None:
        self._inner, self.codec = inner, inner.codec
        self._now_ns = clock.now_ns
        self._inbound = None if inbound is None else _Lane("inbound", inbound, timers, clock)
        self._outbound = None if outbound is None else _Lane("outbound", outbound, timers, clock)

    def publisher(self, key: str, qos: Qos) -> Put:
        """Publisher whose payloads the outbound link loses, delays or doubles. The plain one without such a
        link, or for a key that does not cross to the other end.
        """
        put = self._inner.publisher(key, qos)
        lane = self._outbound
        if lane is None or not crosses(key):
            return put
        send = lane.guarded(put)
        return lambda payload: lane.carry(partial(send, payload))

    def subscribe(self, key: str, handler: Handler) -> None:
        """Subscribes `handler` to what the inbound link lets through, handed over late, on the timers'
        thread, and stamped then. Unimpaired without such a link, or for a key that does not cross.
        """
        lane = self._inbound
        if lane is None or not crosses(key):
            self._inner.subscribe(key, handler)
            return
        now_ns = self._now_ns
        receive = lane.guarded(lambda payload: handler(payload, now_ns()))
        self._inner.subscribe(key, lambda payload, _: lane.carry(partial(receive, payload)))

    def polled(self, key: str, handler: Handler, most: int = MOST_POLLED) -> Poll:
        """Subscribes without a thread; the poll hands over, stamped then, at most `most` payloads whose delay
        ends within half a tick or before. Unimpaired without an inbound link, or for a key that does not
        cross.
        """
        lane = self._inbound
        if lane is None or not crosses(key):
            return self._inner.polled(key, handler, most)
        now_ns, order, waiting = self._now_ns, count(), list[tuple[int, int, bytes]]()

        def wait(payload: bytes, receive_ns: int) -> None:
            for delay_ns in lane.delays_ns(receive_ns):
                heapq.heappush(waiting, (receive_ns + delay_ns, next(order), payload))

        arrived = self._inner.polled(key, wait, most)

        def poll() -> None:
            """Takes what arrived, then hands over what is due within half a tick, `most` at once."""
            arrived()
            stamp_ns = now_ns()
            for _ in range(most):
                if lane.closed or not waiting or waiting[0][0] > stamp_ns + TICK_NS // 2:
                    return
                handler(heapq.heappop(waiting)[2], stamp_ns)

        return poll

    def subscribe_all(self, prefix: str, handler: KeyedHandler) -> None:
        """Delivers what other sessions put to `prefix` or below it, never impaired: this is for observers."""
        self._inner.subscribe_all(prefix, handler)

    def peers(self) -> int:
        return self._inner.peers()

    def close(self) -> None:
        for lane in self._lanes():
            lane.close()
        self._inner.close()

    def drain_trace(self) -> list[TraceChunk]:
        """Trace of the links since the last call; gaps in its indices are what nobody drained in time."""
        return [chunk for lane in self._lanes() for chunk in lane.drain()]

    def _lanes(self) -> list["_Lane"]:
        return [lane for lane in (self._inbound, self._outbound) if lane is not None]


class _Lane:
    """One direction: its link behind a lock, for payloads come from several threads, and its trace."""

    def __init__(self, name: str, link: ImpairedLink, timers: Timers, clock: Clock) -> None:
        self._name = name
        self._link = link
        self._call_at = timers.call_at
        self._now_ns = clock.now_ns
        self._lock = threading.Lock()
        self.closed = False
        self._messages = 0
        self._trace: deque[tuple[int, ...]] = deque(maxlen=_TRACE_CAPACITY)

    def guarded(self, deliver: Put) -> Put:
        """Wraps `deliver` so that it does nothing once the lane is closed."""

        def arrive(payload: bytes) -> None:
            if not self.closed:
                deliver(payload)

        return arrive

    def carry(self, deliver: Callable[[], None]) -> None:
        """Schedules `deliver` after each delay that the link plans for a payload now; not for a lost one."""
        with self._lock:
            now_ns = self._now_ns()
            for delay_ns in self._planned_ns(now_ns):
                self._call_at(now_ns + delay_ns, deliver)

    def delays_ns(self, now_ns: int) -> tuple[int, ...]:
        """Delays that the link plans for a payload that came at `now_ns`; none once the lane is closed."""
        with self._lock:
            return self._planned_ns(now_ns)

    def _planned_ns(self, now_ns: int) -> tuple[int, ...]:
        """Delays in ns that the link plans for a payload, two where it is doubled, none where it is lost;
        adds them to the trace. Empty, without an entry, once the lane is closed. The caller holds the lock.
        """
        if self.closed:
            return ()
        delays_ns = self._link.plan(now_ns)
        self._messages += 1
        self._trace.append(delays_ns)
        return delays_ns

    def drain(self) -> list[TraceChunk]:
        """Removes and returns the trace since the last call, in chunks that fit into a message each."""
        with self._lock:
            first, entries = self._messages - len(self._trace), tuple(self._trace)
            self._trace.clear()
        return [
            TraceChunk(self._name, first + i, entries[i : i + _CHUNK_MESSAGES])
            for i in range(0, len(entries), _CHUNK_MESSAGES)
        ]

    def close(self) -> None:
        self.closed = True
