"""Why there is no answer: probes endpoints with TCP and TLS, and names what is in the way and what to do."""

import socket
import ssl
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from forefeel.common.clock import Clock, now_utc
from forefeel.common.errors import EndpointError
from forefeel.common.events.text import span
from forefeel.common.runtime.real import HOST, Host
from forefeel.common.transport.endpoints import address, parts
from forefeel.common.transport.pki import read_identity
from forefeel.common.transport.security import Party, PartyFiles
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.terminal import say

TIMEOUT_S = 2.0
"""Each step of a probe takes at most as long: an end that needs more counts as silent."""
_REFUSAL_S = 0.2
"""With TLS 1.3 our handshake is done before the other end has seen our certificate. It refuses it within a
round trip, and what it takes to check it."""
_EVERY_NS = 5_000_000_000  # between two probes of what does not answer

_COMPARE = "compare `forefeel pki show DIR` and `date -u` on both hosts"
_NAMES = "`forefeel pki init DIR --hosts CELL/ROLE=ADDRESS,...`; copy its certificate there, restart that end"
_REMEDIES = {
    10: "`forefeel pki init DIR` renews it; copy it there, restart that end",
    **dict.fromkeys((62, 64), _NAMES),
}
"""For a certificate that has expired, or names another host or address, by X509_V_ERR_*."""


class Obstacle(NamedTuple):
    """What is in the way, and what to do."""

    what: str
    advice: str


Probe = Callable[[], Sequence[Obstacle]]
"""Finds one for each endpoint that can not be reached. Blocks for some seconds."""


@dataclass(frozen=True, slots=True)
class Reached:
    """Result of a probe. `connect_s`: of TCP, one round trip; `handshake_s`: of TLS; None: not done.
    All are None where the protocol can not be tried like this.
    """

    endpoint: str
    connect_s: float | None = None
    handshake_s: float | None = None
    obstacle: Obstacle | None = None


def reach(endpoint: str, identity: PartyFiles | None, other: str, timeout_s: float = TIMEOUT_S) -> Reached:
    """Connects, shakes hands and hangs up in order. Blocks for some seconds at most, raises nothing.

    Args:
        endpoint: where.
        identity: our certificates; without them TCP is tried alone, also below TLS.
        other: who is expected there, in a word.
        timeout_s: of each step.
    """
    connect_s: float | None = None
    try:
        protocol, host, port = parts(endpoint)
        if protocol not in {"tcp", "tls"}:
            return Reached(endpoint)
        start_s = time.monotonic()
        with socket.create_connection((host, port), timeout_s) as plain:
            connect_s = time.monotonic() - start_s
            if protocol == "tcp" or identity is None:
                return Reached(endpoint, connect_s)
            return Reached(endpoint, connect_s, _shake_hands(plain, host, identity, connect_s))
    except EndpointError:
        return Reached(endpoint)
    except (OSError, ValueError) as error:  # ValueError: of a name that can not be one
        return Reached(
            endpoint, connect_s, obstacle=_obstacle(error, address(endpoint), other, bool(connect_s))
        )


def _shake_hands(plain: socket.socket, host: str, identity: PartyFiles, round_trip_s: float) -> float:
    """Duration of the handshake in s, with what Zenoh asks for: our authority, the name of the host, and our
    certificate to show.

    Raises:
        OSError: it failed.
    """
    context = ssl.create_default_context(cafile=str(identity.authority))
    context.load_cert_chain(str(identity.certificate), str(identity.key))
    start_s = time.monotonic()
    with context.wrap_socket(plain, server_hostname=host) as secured:
        handshake_s = time.monotonic() - start_s
        secured.settimeout(_REFUSAL_S + 2.0 * round_trip_s)
        with suppress(TimeoutError):
            secured.recv(1)
        with suppress(OSError):
            secured.unwrap()
    return handshake_s


def _obstacle(error: Exception, where: str, other: str, connected: bool) -> Obstacle:
    why = getattr(error, "reason", None) or getattr(error, "strerror", None) or error
    match error:
        case ssl.SSLCertVerificationError():
            why = error.verify_message.rstrip(".")
            advice = _REMEDIES.get(error.verify_code, _COMPARE)
            return Obstacle(f"the certificate of {where} is not accepted: {why}", advice)
        case TimeoutError() if connected:
            what = f"{where} accepts the connection and says nothing"
            return Obstacle(what, f"look whether the {other} there hangs")
        case TimeoutError():
            return Obstacle(f"no answer from {where}", "check cable, address and firewall")
        case ConnectionRefusedError():
            return Obstacle(f"{where} refuses the connection", f"start the {other} there")
        case ssl.SSLError():
            return Obstacle(f"{where} breaks the TLS handshake off ({why})", _COMPARE)
        case _:
            return Obstacle(f"no way to {where} ({why})", "check its name, cable, address and routes")


def probe_of(transport: TransportSettings, party: Party, other: str) -> Probe:
    """What is in the way of connections to `transport.connect`; who is expected there is `other`, in a word.

    `party`: whose certificates ours are, which a session reads once, when it opens.

    Raises:
        ConfigurationError: a file of `transport.pki` is missing or not what it should be.
    """
    identity: PartyFiles | None = None
    if transport.pki is not None:
        identity = read_identity(transport.pki, party, now_utc()).identity

    def probe() -> Sequence[Obstacle]:
        reached = [reach(each, identity, other) for each in transport.connect]
        return [each.obstacle for each in reached if each.obstacle is not None]

    return probe


def unheard(transport: TransportSettings, connected: bool, missing: str) -> str:
    """Why nobody is heard although nothing is in the way: no Zenoh there, or not who is missing."""
    where = ", ".join(map(address, transport.connect or transport.listen))
    if connected:
        return f"{where} is connected, but {missing}"
    if transport.connect:
        advice = "" if transport.pki else ": certificates there need tls/ and transport.pki (--pki) here"
        return f"no Zenoh session with {where} opens{advice}"
    return f"nobody has connected to {where}"


class AnswerWatch:
    """Reports every 5 s why somebody who is waited for does not answer.

    The endpoints are probed in a thread, so that `look` never blocks.

    Args:
        unheard: text where nothing is in the way.
        report: takes the cause.

    Attributes:
        found: the cause that the last probe found; empty before, and when the cause is known without one.
    """

    def __init__(
        self,
        find: Probe,
        unheard: Callable[[], str],
        report: Callable[[str], None],
        host: Host = HOST,
    ) -> None:
        self._find, self._unheard, self._report, self._host = find, unheard, report, host
        self._since_ns: int | None = None
        self._due_ns = 0
        self._probe: Future[Sequence[Obstacle]] | None = None
        self.found = ""

    def look(self, now_ns: int, known: str = "") -> None:
        """Goes on waiting; many times a second. `known`: the cause, where no probe is needed to know it."""
        if self._since_ns is None:
            self._since_ns, self._due_ns = now_ns, now_ns + _EVERY_NS
        if known:
            self.found, self._probe = "", None
        if self._probe is not None and self._probe.done():
            self.found = self.cause(self._probe.result(), now_ns)
            self._probe = None
            self._report(self.found)
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _EVERY_NS
        if known:
            self._report(f"{known} ({self._waited(now_ns)})")
        elif self._probe is None:
            self._probe = self.probe()

    def over(self) -> None:
        """Somebody answers; a probe under way is not reported any more."""
        self._since_ns, self._probe, self.found = None, None, ""

    def probe(self) -> "Future[Sequence[Obstacle]]":
        return self._host.in_thread(self._find, "probe of endpoints")

    def cause(self, found: Sequence[Obstacle], now_ns: int) -> str:
        texts = [f"{each.what}: {each.advice}" for each in found] or [self._unheard()]
        return f"{'; '.join(texts)} ({self._waited(now_ns)})"

    def _waited(self, now_ns: int) -> str:
        return span(0.0 if self._since_ns is None else (now_ns - self._since_ns) * 1e-9)


def cell_watch(
    own: TransportSettings, party: Party, transport: ZenohTransport, clock: Clock
) -> Callable[[bool], str]:
    """Prints every 5 s why nobody of a cell is heard; call the result often, with whether somebody is."""

    def nobody() -> str:
        return unheard(own, transport.peers() > 0, f"nobody of cell {party.cells[0]} is heard there")

    other = "router" if own.mode == "client" else "daemon"
    watch = AnswerWatch(probe_of(own, party, other), nobody, lambda why: say(f"nobody heard yet: {why}"))

    def look(heard: bool) -> str:
        if heard:
            watch.over()
            return ""
        known = transport.hint or (nobody() if transport.peers() and not own.listen else "")
        watch.look(clock.now_ns(), known)
        return known or watch.found

    return look
