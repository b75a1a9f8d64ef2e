"""The transport over several connections to the same end, between which the streams take turns."""

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import cycle, pairwise
from typing import Self

from common.clock import Clock
from common.errors import EndpointError
from common.topics import Qos, parse_key
from common.transport.endpoints import check_endpoint, port_of, shifted
from common.transport.port import Handler, KeyedHandler, OnFault, Put
from common.transport.security import Party
from common.transport.settings import TransportSettings
from common.transport.zenoh_bus import WAITING_OBSERVED, ZenohTransport


class StrandedTransport:
    """`TransportSettings.strands` Zenoh sessions with the same rules. See the port for the contract.

    TCP, and TLS above it, deliver in order: a lost packet holds back all that follows on its connection for a
    round trip and more, far beyond the watchdog. So each message of a stream goes over the next connection:
    while one waits for its packet the others go on, and what it then delivers is late, as a message that was
    overtaken. Reliable topics go over the first connection alone, which keeps their order.

    A connection that nobody listens on, as to an end with fewer of them, is left out.

    Attributes:
        notice: what the user must be told loudly about this session, or empty.
    """

    def __init__(self, strands: Sequence[ZenohTransport]) -> None:
        self._first, self._strands = strands[0], tuple(strands)
        self.notice = self._first.notice

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
        """All of them, or none. See `ZenohTransport.open`, also for what is raised.

        Raises:
            EndpointError: also where two endpoints would listen on the same port.
        """
        _check_ports(settings)
        with ExitStack() as opened:
            strands = []
            for number in range(settings.strands):
                strand = ZenohTransport.open(
                    _strand(settings, number),
                    clock,
                    on_fault,
                    party,
                    insecure=insecure,
                    real_stage=real_stage,
                )
                opened.callback(strand.close)
                strands.append(strand)
            opened.pop_all()
        return cls(strands)

    def publisher(self, key: str, qos: Qos) -> Put:
        """A stream over all of them, anything else over the first."""
        if qos is not Qos.STREAM or len(self._strands) == 1:
            return self._first.publisher(key, qos)
        return in_turn([strand.heard_publisher(key, qos) for strand in self._strands])

    def subscribe(self, key: str, handler: Handler) -> None:
        """Delivers one message at a time, from whichever connection."""
        serial = threading.Lock()

        def deliver(payload: bytes, receive_ns: int) -> None:
            with serial:
                handler(payload, receive_ns)

        for strand in self._carrying(key):
            strand.subscribe(key, deliver)

    def subscribe_all(self, prefix: str, handler: KeyedHandler, waiting: int = WAITING_OBSERVED) -> None:
        """Delivers one message at a time, from whichever connection; of more than `waiting` the newest."""
        serial = threading.Lock()

        def deliver(key: str, payload: bytes, receive_ns: int) -> None:
            with serial:
                handler(key, payload, receive_ns)

        for strand in self._strands:
            strand.subscribe_all(prefix, deliver, waiting)

    def peers(self) -> int:
        """How many other ends are connected now."""
        return self._first.peers()

    @property
    def amiss(self) -> str:
        """What is wrong with the connections while somebody is there, or empty."""
        peers = [strand.peers() for strand in self._strands]
        if min(peers) >= peers[0]:
            return ""
        there = sum(count >= peers[0] for count in peers)
        return (
            f"{there} of {len(peers)} connections stand; "
            "expected the same transport.strands at every end and all their ports open"
        )

    @property
    def hint(self) -> str:
        """What may stand in the way, or empty."""
        return self.amiss or self._first.hint

    def refused(self) -> int:
        """How many payloads came under a key with a wildcard."""
        return sum(strand.refused() for strand in self._strands)

    @property
    def handler_faults(self) -> int:
        """Exceptions that handlers raised."""
        return sum(strand.handler_faults for strand in self._strands)

    def close(self) -> None:
        """All of them; the first last, whose events are the latest."""
        for strand in reversed(self._strands):
            strand.close()

    def _carrying(self, key: str) -> Sequence[ZenohTransport]:
        parsed = parse_key(key)
        reliable = parsed is not None and parsed[2].qos is not Qos.STREAM
        return self._strands[:1] if reliable else self._strands


def in_turn(outlets: Sequence[tuple[Put, Callable[[], bool]]]) -> Put:
    """Sends by the next outlet that is heard; by the first where none is known to be."""
    turns = cycle(outlets)

    def put(payload: bytes) -> None:
        for _ in outlets:
            send, heard = next(turns)
            if heard():
                send(payload)
                return
        outlets[0][0](payload)

    return put


def _strand(settings: TransportSettings, number: int) -> TransportSettings:
    """The settings of one session: every port is higher by its number."""
    return settings.model_copy(
        update={
            "listen": tuple(shifted(endpoint, number) for endpoint in settings.listen),
            "connect": tuple(shifted(endpoint, number) for endpoint in settings.connect),
        }
    )


def _check_ports(settings: TransportSettings) -> None:
    for endpoint in settings.listen + settings.connect:
        check_endpoint(shifted(endpoint, settings.strands - 1))
    ports = sorted((port_of(endpoint), endpoint) for endpoint in settings.listen)
    for (low, _), (high, endpoint) in pairwise(ports):
        if 0 < high - low < settings.strands:
            raise EndpointError(
                f"endpoint {endpoint!r}: within the {settings.strands} ports of another one from {low}; "
                "expected them at least transport.strands apart"
            )
