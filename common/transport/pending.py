"""Bounds the connections of which no session has come: who has no certificate holds no more than these.

Zenoh accepts TCP connections without bound. When the last descriptor of the process is taken, its listener
fails at each attempt to accept one more, and never again looks at those that it has accepted, also after
they were closed (docs/decisions/0026). So they are closed here before it comes to that, and where it has
come to that, the kernel's queue is emptied, after which the listener goes on.
"""

import socket
import struct
import threading
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from ipaddress import IPv6Address, ip_address
from typing import NamedTuple, Self

from forefeel.common.clock import Clock
from forefeel.common.runtime.descriptors import DESCRIPTORS
from forefeel.common.transport.endpoints import address, parts
from forefeel.common.transport.port import OnFault
from forefeel.common.transport.settings import TransportSettings

MOST = 64
"""Connections that may be in their handshake at once: a master opens 16, a viewer one."""
MOST_SILENT = 24
"""Of these, such as said nothing yet. Zenoh gives up at most ten failed ones in a second, and a new session
has to come within five seconds after a flood.
"""
SILENT_S = 2.0
"""How long one may say nothing. Who connects speaks in its next packet; one that is lost is sent again
within a second and a round trip.
"""
_OWN = 40
"""Descriptors that the process opens itself between two looks: 16 connections to each of two endpoints, and
its devices. They are granted while nobody is silent.
"""
# s between two looks; chosen, not measured: shorter costs processor time, longer lets more pile up
_LOOK_S = 0.1
_LOOK_CLOSELY_S = 0.02
"""While there are as many silent ones as there may be."""
_QUEUED = 4096
"""More than the kernel keeps for a listener (net.core.somaxconn)."""
# bytes of struct tcp_info up to the end of tcpi_bytes_received, 8 bytes from _RECEIVED_AT on
_TCP_INFO_BYTES = 136
_RECEIVED_AT = 128
"""Of tcpi_bytes_received in struct tcp_info (linux/tcp.h), since Linux 4.1."""

Address = tuple[str, int]
"""Host without brackets, and port."""


class Accepted(NamedTuple):
    """A connection to one of our ports: its descriptor, the other end, whether nothing has come from it."""

    descriptor: int
    peer: Address
    silent: bool


def before_listening() -> None:
    """Bounds what comes between the opening of a port and the first look."""
    DESCRIPTORS.allow(MOST_SILENT + _OWN, DESCRIPTORS.used())


class PendingConnections:
    """Looks at the process's own sockets, in a thread of its own while it is entered.

    Args:
        settings: where the process listens, and how long a handshake may take.
        links: the locators of the other ends of which a session has come.
        on_fault: takes what ends the thread.

    Attributes:
        closed: how many connections were closed.
    """

    def __init__(
        self,
        settings: TransportSettings,
        links: Callable[[], Collection[str]],
        clock: Clock,
        on_fault: OnFault,
    ) -> None:
        self.closed = 0
        self._ports = frozenset(parts(endpoint)[2] for endpoint in settings.listen)
        self._links, self._clock, self._on_fault = links, clock, on_fault
        self._timeout_ns, self._silent_ns = int(settings.open_timeout_s * 1e9), int(SILENT_S * 1e9)
        self._settled: frozenset[Address] = frozenset()
        self._since_ns: dict[Address, int] = {}
        self._ended: set[Address] = set()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pending connections", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        DESCRIPTORS.allow_all()

    def _run(self) -> None:
        closely = False
        try:
            while not self._ending.wait(_LOOK_CLOSELY_S if closely else _LOOK_S):
                closely = self.look()
        except Exception as error:  # noqa: BLE001 - the edge of the thread
            self._on_fault(error)

    def look(self) -> bool:
        """Closes those that are too many or have waited too long; whether as many say nothing as may be.

        The kernel bounds by the limit of descriptors what comes between two looks.
        """
        used = DESCRIPTORS.used()
        listeners, accepted = self._sockets(used)
        pending = self._pending(accepted)
        for each in self._doomed(pending, self._clock.now_ns()):
            with suppress(OSError), _borrowed(each.descriptor) as connection:
                connection.shutdown(socket.SHUT_RDWR)
                self.closed += each.peer not in self._ended
                self._ended.add(each.peer)
        silent = sum(each.silent for each in pending)
        room = MOST_SILENT - silent if silent else MOST_SILENT + _OWN
        if room <= 0:
            refused = sum(_emptied(listener) for listener in listeners)
            self.closed += refused
            room = 0 if refused else 1  # with one Zenoh finds nobody waiting, and looks at those it has
        DESCRIPTORS.allow(room, used)
        return room <= 1

    def _sockets(self, descriptors: Iterable[int]) -> tuple[list[int], list[Accepted]]:
        """Descriptors of the listeners, and the connections that were accepted."""
        listeners: list[int] = []
        accepted: list[Accepted] = []
        for descriptor in descriptors:
            with suppress(OSError), _borrowed(descriptor) as found:
                if found.family not in {socket.AF_INET, socket.AF_INET6} or found.type != socket.SOCK_STREAM:
                    continue
                if found.getsockname()[1] not in self._ports:
                    continue
                if found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                    listeners.append(descriptor)
                else:
                    accepted.append(_accepted(descriptor, found))
        return listeners, accepted

    def _pending(self, accepted: list[Accepted]) -> list[Accepted]:
        """Those of which no session has come. Zenoh is asked only where one is new."""
        peers = {each.peer for each in accepted}
        self._settled &= peers
        if peers - self._settled:
            self._settled = frozenset(_plain(locator) for locator in self._links()) & peers
        return [each for each in accepted if each.peer not in self._settled]

    def _doomed(self, pending: list[Accepted], now_ns: int) -> list[Accepted]:
        """Too old, and those beyond `MOST`: first who said nothing, of these the oldest."""
        self._ended &= {each.peer for each in pending}
        self._since_ns = {each.peer: self._since_ns.get(each.peer, now_ns) for each in pending}
        waited_ns = {peer: now_ns - since_ns for peer, since_ns in self._since_ns.items()}
        order = sorted(pending, key=lambda each: (not each.silent, -waited_ns[each.peer]))
        excess = max(0, len(order) - MOST)
        return [
            each
            for at, each in enumerate(order)
            if at < excess or waited_ns[each.peer] > (self._silent_ns if each.silent else self._timeout_ns)
        ]


def _accepted(descriptor: int, found: socket.socket) -> Accepted:
    info = found.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO_BYTES)
    (received,) = struct.unpack_from("Q", info, _RECEIVED_AT)
    host, port = found.getpeername()[:2]
    return Accepted(descriptor, (_unmapped(host), port), received == 0)


@contextmanager
def _borrowed(descriptor: int) -> Iterator[socket.socket]:
    """A descriptor that Zenoh owns, as a socket that does not close it.

    Raises:
        OSError: it is none.
    """
    found = socket.socket(fileno=descriptor)
    try:
        yield found
    finally:
        found.detach()


def _emptied(listener: int) -> int:
    """Accepts and closes what waits there, which Zenoh can not; how many."""
    with DESCRIPTORS.reserve(1), suppress(OSError), _borrowed(listener) as found:
        for count in range(_QUEUED):
            try:
                found.accept()[0].close()
            except OSError:
                return count
    return _QUEUED


def _plain(locator: str) -> Address:
    """Of a locator such as tls/[::1]:7447."""
    host, _, port = address(locator).rpartition(":")
    return _unmapped(host.strip("[]")), int(port)


def _unmapped(host: str) -> str:
    """An IPv4 address as such where a socket of IPv6 shows it as ::ffff:192.0.2.7."""
    found = ip_address(host.partition("%")[0])
    mapped = found.ipv4_mapped if isinstance(found, IPv6Address) else None
    return str(mapped or found)
