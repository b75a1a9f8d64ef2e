"""A memory bus as a test uses it: all that is put on it, and a party whose messages the test writes."""

from collections import defaultdict
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from forefeel.common.bus import Bus, Publisher, observed
from forefeel.common.clock import VirtualClock
from forefeel.common.codec import decode, encode
from forefeel.common.messages import Message
from forefeel.common.topics import BY_NAME, SAFETY_EVENT, SLAVE_STATE, Qos, Topic, direct, parse_key
from forefeel.common.transport.memory import MemoryBus, MemoryTransport
from forefeel.common.transport.port import Put
from forefeel.loopback.virtual import VirtualLoopback
from tests.messages import usual

M = TypeVar("M", bound=Message)
S = 1_000_000_000
CELL, AXIS = "cell", "insertion"
Payload = tuple[str, bytes, int]
"""Key, bytes and receive stamp in ns."""


class Traffic:
    """Payloads on a bus in the order in which they were put; each is decoded once, when asked for."""

    def __init__(self, session: MemoryTransport | None = None) -> None:
        self.payloads: list[Payload] = []
        self._sorted = 0
        self._of_key: defaultdict[tuple[str, str], list[bytes]] = defaultdict(list)
        self._decoded: defaultdict[tuple[str, str], list[Any]] = defaultdict(list)
        if session is not None:
            session.subscribe_all("forefeel", self._observe)
            session.subscribe_all(direct("forefeel"), self._record)

    def _observe(self, key: str, payload: bytes, receive_ns: int) -> None:
        topic = BY_NAME[key.split("/", 3)[3]]
        if not topic.batched:
            self._record(key, payload, receive_ns)
        elif not topic.crosses:
            for sample, stamp_ns in observed(topic, payload, receive_ns):
                self._record(key, encode(sample), stamp_ns)

    def _record(self, key: str, payload: bytes, receive_ns: int) -> None:
        self.payloads.append((key.removeprefix(direct("")), payload, receive_ns))

    def encoded(self, topic: Topic[Any], axis: str = AXIS) -> list[bytes]:
        """Payloads of the topic; the list grows with the traffic."""
        for key, payload, _ in self.payloads[self._sorted :]:
            if (parsed := parse_key(key)) is not None:
                self._of_key[parsed[1], parsed[2].name].append(payload)
        self._sorted = len(self.payloads)
        return self._of_key[axis, topic.name]

    def messages(self, topic: Topic[M], axis: str = AXIS) -> list[M]:
        encoded, decoded = self.encoded(topic, axis), self._decoded[axis, topic.name]
        decoded += [decode(topic.message, payload) for payload in encoded[len(decoded) :]]
        return list(decoded)

    def newest(self, topic: Topic[M], axis: str = AXIS) -> M:
        """Last message of the topic; IndexError before the first."""
        return self.messages(topic, axis)[-1]

    def column(self, topic: Topic[Any], name: str, axis: str = AXIS) -> NDArray[np.float64]:
        """One field as float64; None is NaN."""
        return np.array([getattr(m, name) for m in self.messages(topic, axis)], dtype=np.float64)

    def events(self, axis: str = AXIS) -> list[tuple[float, str]]:
        """(time in s, event) of each transition of the slave's safety state."""
        return [(m.stamp_ns / S, m.event) for m in self.messages(SAFETY_EVENT, axis)]

    def times(self, event: str, axis: str = AXIS) -> list[float]:
        return [time_s for time_s, name in self.events(axis) if name == event]

    def armed_share(self, until_s: float, axis: str = AXIS) -> float:
        """Share of the time since the first arming in which the slave was armed."""
        states = [m.state.value for m in self.messages(SLAVE_STATE, axis) if m.stamp_ns < until_s * S]
        since = states[states.index("armed") :] if "armed" in states else []
        return since.count("armed") / len(since) if since else 0.0


def traffic_of(loop: VirtualLoopback) -> Traffic:
    traffic = Traffic()
    traffic.payloads = [(key, encode(sample), stamp_ns) for key, sample, stamp_ns in loop.messages]
    return traffic


class Party:
    """A session of one axis whose messages a test writes, and the traffic of the whole bus, read by one that
    is given or by its own.
    """

    def __init__(self, network: MemoryBus, clock: VirtualClock, traffic: Traffic | None = None) -> None:
        self.network, self.clock = network, clock
        self.session = network.session(clock)
        self.bus = Bus(self.session, CELL, AXIS, clock)
        self.traffic = traffic or Traffic(network.session(clock))
        self.messages, self.newest = self.traffic.messages, self.traffic.newest
        self._publishers: dict[str, Publisher] = {}
        self._puts: dict[str, Put] = {}

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns()

    def write(self, topic: Topic[M], session_id: int, stamp_ns: int | None = None, **fields: Any) -> M:  # noqa: ANN401
        """A message with the next number, stamped now unless `stamp_ns` says when; not sent."""
        if topic.name not in self._publishers:
            self._publishers[topic.name] = self.bus.publisher(topic)
        stamp_ns = self.now_ns if stamp_ns is None else stamp_ns
        return usual(topic, **{**self._publishers[topic.name].header(session_id, stamp_ns), **fields})

    def send(self, topic: Topic[M], written: M) -> M:
        self._publishers[topic.name].send(written)
        return written

    def say(self, topic: Topic[M], session_id: int, stamp_ns: int | None = None, **fields: Any) -> M:  # noqa: ANN401
        """Writes and sends a message; see `write`."""
        return self.send(topic, self.write(topic, session_id, stamp_ns, **fields))

    def put(self, topic: Topic[Any], payload: bytes) -> None:
        """Puts bytes where the other end takes that topic, whatever they are."""
        if topic.name not in self._puts:
            self._puts[topic.name] = self.session.publisher(topic.taken_key(CELL, AXIS), Qos.STREAM)
        self._puts[topic.name](payload)
