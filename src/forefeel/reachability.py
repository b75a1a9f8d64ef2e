"""Probes of endpoints with TCP and TLS: why there is no answer, and what to do."""

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

TIMEOUT_S = 2.0  # each step of a probe takes at most as long: an end that needs more counts as silent
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
    """An obstacle to a connection, and what to do."""

    what: str
    advice: str


Probe = Callable[[], Sequence[Obstacle]]
"""Finds the obstacle to each endpoint that can not be reached. Blocks for some seconds."""


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
    """Probes an endpoint: connects by TCP, shakes hands for TLS, and hangs up in order; returns times or
    obstacle. Blocks for some seconds at most, raises nothing. A malformed endpoint, or another protocol, is
    not tried.

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
    """Does the TLS handshake as Zenoh does, with our authority, the host's name and our certificate, waits
    0.2 s and two round trips for a refusal of ours, and closes; returns the handshake's time. Raises OSError.
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
    """Obstacle behind an error of connecting, with remedy. `connected`: TCP was; `other`: expected there."""
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
    """Makes a function that tries each endpoint of `transport.connect` and returns the obstacles; it blocks.
    Reads our certificates, those of `party`, now, once, as a session does. `other`: who is expected there.

    Raises:
        ConfigurationError: a file of `transport.pki` is missing or not what it should be.
    """
    identity: PartyFiles | None = None
    if transport.pki is not None:
        identity = read_identity(transport.pki, party, now_utc()).identity

    def probe() -> Sequence[Obstacle]:
        reached = [reach(endpoint, identity, other) for endpoint in transport.connect]
        return [end.obstacle for end in reached if end.obstacle is not None]

    return probe


def silence_cause(transport: TransportSettings, connected: bool, missing: str) -> str:
    """Text on why nobody answers though no endpoint is obstructed: connected, but `missing`; no Zenoh session
    opens; or, at one that only listens, nobody has connected.
    """
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
        silence: text where nothing is in the way.
        report: takes the cause.

    Attributes:
        last_cause: result of the last probe; empty before, and when the cause is known without one.
    """

    def __init__(
        self,
        find: Probe,
        silence: Callable[[], str],
        report: Callable[[str], None],
        host: Host = HOST,
    ) -> None:
        self._find, self._silence, self._report, self._host = find, silence, report, host
        self._since_ns: int | None = None
        self._due_ns = 0
        self._probe: Future[Sequence[Obstacle]] | None = None
        self.last_cause = ""

    def look(self, now_ns: int, known: str = "") -> None:
        """Reports every 5 s, first after 5 s, why there is no answer: `known`, the cause if one is known
        without a probe, else the result of a probe that it starts, once that is done. Sets `last_cause` to
        the latter, empty where `known` is given. To be called many times a second.
        """
        if self._since_ns is None:
            self._since_ns, self._due_ns = now_ns, now_ns + _EVERY_NS
        if known:
            self.last_cause, self._probe = "", None
        if self._probe is not None and self._probe.done():
            self.last_cause = self.cause(self._probe.result(), now_ns)
            self._probe = None
            self._report(self.last_cause)
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _EVERY_NS
        if known:
            self._report(f"{known} ({self._waited(now_ns)})")
        elif self._probe is None:
            self._probe = self.probe()

    def over(self) -> None:
        """Ends the waiting, for somebody answers; a probe under way is not reported any more."""
        self._since_ns, self._probe, self.last_cause = None, None, ""

    def probe(self) -> "Future[Sequence[Obstacle]]":
        return self._host.in_thread(self._find, "probe of endpoints")

    def cause(self, obstacles: Sequence[Obstacle], now_ns: int) -> str:
        texts = [f"{obstacle.what}: {obstacle.advice}" for obstacle in obstacles] or [self._silence()]
        return f"{'; '.join(texts)} ({self._waited(now_ns)})"

    def _waited(self, now_ns: int) -> str:
        return span(0.0 if self._since_ns is None else (now_ns - self._since_ns) * 1e-9)


def cell_watch(
    settings: TransportSettings, party: Party, transport: ZenohTransport, clock: Clock
) -> Callable[[bool], str]:
    """Makes a function to be called often, with True if anybody of the cell is heard: it prints every 5 s why
    nobody is, and returns that cause; empty if somebody is, or no probe is done yet.

    Raises:
        ConfigurationError: a file of `settings.pki` is missing or not what it should be.
    """

    def nobody() -> str:
        missing = f"nobody of cell {party.cells[0]} is heard there"
        return silence_cause(settings, transport.peers() > 0, missing)

    other = "router" if settings.mode == "client" else "daemon"
    watch = AnswerWatch(probe_of(settings, party, other), nobody, lambda why: say(f"nobody heard yet: {why}"))

    def look(answering: bool) -> str:
        """Prints every 5 s why nobody is heard, unless `answering`; returns the cause, or empty."""
        if answering:
            watch.over()
            return ""
        known = transport.hint or (nobody() if transport.peers() and not settings.listen else "")
        watch.look(clock.now_ns(), known)
        return known or watch.last_cause

    return look
