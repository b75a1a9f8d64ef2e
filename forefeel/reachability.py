"""Why there is no answer: probes endpoints with TCP and TLS, and names what is in the way and what to do."""

import socket
import ssl
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from forefeel.common.clock import now_utc
from forefeel.common.errors import EndpointError
from forefeel.common.events.text import span
from forefeel.common.runtime.real import HOST, Host
from forefeel.common.transport.endpoints import address, parts
from forefeel.common.transport.pki import read_certificate, read_identity, renewal
from forefeel.common.transport.security import Party, PartyFiles
from forefeel.common.transport.settings import TransportSettings

TIMEOUT_S = 2.0
"""Each step of a probe takes at most as long: an end that needs more counts as silent."""
_REFUSAL_S = 0.2
"""With TLS 1.3 our handshake is done before the other end has seen our certificate. It refuses it within a
round trip, and what it takes to check it."""
_EVERY_NS = 5_000_000_000  # between two probes of what does not answer

_COMPARE = "compare forefeel pki show on both hosts"
_THEIRS = {
    10: ("expired", "forefeel pki init DIR renews it; copy it there, start that end anew"),
    9: ("is not valid yet", "compare date -u on both hosts"),
    **dict.fromkeys(
        (62, 64), ("does not name that host", "forefeel pki init DIR --hosts ROLE=ADDRESS, copy it there")
    ),
    **dict.fromkeys(
        (2, 7, 18, 19, 20, 21), ("is of another authority", "both hosts need those of one forefeel pki init")
    ),
}
"""Why OpenSSL does not accept a certificate, by X509_V_ERR_*."""


class Obstacle(NamedTuple):
    """What is in the way, and what to do. `silent`: that the other end does not answer, for however long."""

    what: str
    advice: str
    silent: bool = False


@dataclass(frozen=True, slots=True)
class Reached:
    """Result of a probe. `connect_s`: of TCP, one round trip; `handshake_s`: of TLS; None: not done.
    `tried`: False where the protocol can not be tried like this.
    """

    endpoint: str
    tried: bool = True
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
            return Reached(endpoint, tried=False)
        start_s = time.monotonic()
        with socket.create_connection((host, port), timeout_s) as plain:
            connect_s = time.monotonic() - start_s
            if protocol == "tcp" or identity is None:
                return Reached(endpoint, connect_s=connect_s)
            return Reached(endpoint, True, connect_s, _shake_hands(plain, host, identity, connect_s))
    except EndpointError:
        return Reached(endpoint, tried=False)
    except (OSError, ValueError) as error:  # ValueError: of a name that can not be one
        return Reached(endpoint, connect_s=connect_s, obstacle=_obstacle(error, endpoint, other, connect_s))


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


def _obstacle(error: Exception, endpoint: str, other: str, connect_s: float | None) -> Obstacle:
    where = address(endpoint)
    match error:
        case ssl.SSLCertVerificationError():
            found = _THEIRS.get(error.verify_code, (f"is not accepted ({error.verify_message})", _COMPARE))
            what, advice = f"the certificate of {where} {found[0]}", found[1]
        case TimeoutError() if connect_s is None:
            return Obstacle(f"no answer from {where}", "check cable, address and firewall", silent=True)
        case TimeoutError():
            what = f"{where} accepts the connection and says nothing"
            return Obstacle(what, f"look whether the {other} there hangs", silent=True)
        case ConnectionRefusedError():
            what, advice = f"{where} refuses the connection", f"start the {other} there"
        case ssl.SSLError() if "_ALERT_" in (error.reason or ""):
            what = f"{where} refuses our certificate ({_words(error).partition(' alert ')[2]})"
            advice = f"{_COMPARE}, and date -u"
        case socket.gaierror() | ValueError():
            what, advice = f"the name in {where} does not resolve", "check its spelling or give an IP address"
        case _ if connect_s is None:
            what, advice = f"no way to {where} ({_words(error)})", "check cable, address and routes"
        case _:
            what = f"{where} breaks the TLS handshake off ({_words(error)})"
            advice = f"expected a {other} with certificates there"
    return Obstacle(what, advice)


def _words(error: Exception) -> str:
    reason = error.reason if isinstance(error, ssl.SSLError) else None
    strerror = error.strerror if isinstance(error, OSError) else None
    return reason.lower().replace("_", " ") if reason else strerror or str(error)


class Obstacles:
    """Finds what is in the way of connections to the endpoints in `transport.connect`.

    Args:
        transport: names the endpoints, and our certificates, which a session reads once, when it opens.
        party: whose certificates they are.
        other: who is expected at the endpoints, in a word.

    Raises:
        ConfigurationError: a file of `transport.pki` is missing or not what it should be.
    """

    def __init__(self, transport: TransportSettings, party: Party, other: str) -> None:
        self._transport, self._other = transport, other
        self._identity: PartyFiles | None = None
        self._ends: dict[Path, datetime] = {}
        if transport.pki is not None:
            self._identity = read_identity(transport.pki, party, now_utc()).identity
            for path in Path(self._identity.certificate), Path(self._identity.authority):
                self._ends[path] = read_certificate(path).not_valid_after_utc

    def find(self) -> Sequence[Obstacle]:
        """Our own certificate, or one for each endpoint that can not be reached. Blocks for some seconds."""
        found = [
            Obstacle(f"our certificate expired on {end:%Y-%m-%d} ({path})", f"{renewal(path)}, start anew")
            for path, end in self._ends.items()
            if end < now_utc()
        ]
        for endpoint in () if found else self._transport.connect:
            reached = reach(endpoint, self._identity, self._other)
            if reached.obstacle is not None:
                found.append(reached.obstacle)
            elif not reached.tried:
                found.append(Obstacle(f"no answer from {address(endpoint)}", "", silent=True))
        return found


def unheard(transport: TransportSettings, connected: bool, missing: str) -> str:
    """Why nobody is heard although nothing is in the way: no Zenoh there, or not who is missing."""
    where = ", ".join(map(address, transport.connect or transport.listen))
    if connected:
        return f"{where} is connected, but {missing}"
    if transport.connect:
        return f"{where} accepts connections, but none of Zenoh opens"
    return f"nobody has connected to {where}"


def obstacle_text(found: Sequence[Obstacle], waited: str) -> str:
    """The obstacles, what to do, and for how long they have been in the way."""
    texts = [f"{each.what} for {waited}" if each.silent else f"{each.what}: {each.advice}" for each in found]
    timed = all(each.silent for each in found)
    return "; ".join(texts) if timed else f"{'; '.join(texts)} ({waited})"


class AnswerWatch:
    """Reports every 5 s why somebody who is waited for does not answer.

    The endpoints are probed in a thread, one probe at a time, so that `look` never blocks.

    Args:
        obstacles: what may be in the way.
        unheard: text where nothing is in the way.
        report: takes the cause.

    Attributes:
        found: the cause that the last probe found; empty before, and when the cause is known without one.
    """

    def __init__(
        self,
        obstacles: Obstacles,
        unheard: Callable[[], str],
        report: Callable[[str], None],
        host: Host = HOST,
    ) -> None:
        self._obstacles, self._unheard, self._report, self._host = obstacles, unheard, report, host
        self._since_ns: int | None = None
        self._due_ns = 0
        self._probe: Future[Sequence[Obstacle]] | None = None
        self._awaited = False
        self.found = ""

    def look(self, now_ns: int, known: str = "") -> None:
        """Goes on waiting; many times a second. `known`: the cause, where no probe is needed to know it."""
        if self._since_ns is None:
            self._since_ns, self._due_ns = now_ns, now_ns + _EVERY_NS
        if known:
            self.found, self._awaited = "", False
        if self._probe is not None and self._probe.done():
            probe, self._probe = self._probe, None
            if self._awaited:
                self.found = self.cause(probe.result(), now_ns)
                self._report(self.found)
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _EVERY_NS
        if known:
            self._report(f"{known} ({self._waited(now_ns)})")
        elif self._probe is None:
            self._awaited, self._probe = True, self.probe()

    def over(self) -> None:
        """Somebody answers; a probe under way is not reported any more."""
        self._since_ns, self._awaited, self.found = None, False, ""

    def probe(self) -> "Future[Sequence[Obstacle]]":
        return self._host.in_thread(self._obstacles.find, "probe of endpoints")

    def cause(self, found: Sequence[Obstacle], now_ns: int) -> str:
        waited = self._waited(now_ns)
        return obstacle_text(found, waited) if found else f"{self._unheard()} ({waited})"

    def _waited(self, now_ns: int) -> str:
        return span(0.0 if self._since_ns is None else (now_ns - self._since_ns) * 1e-9)
