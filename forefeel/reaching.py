"""Can an endpoint be reached, do both ends accept each other's certificate, and what is in the way if not?

A probe connects, shakes hands and hangs up in order. To the other end it is a connection that nobody uses.
"""

import socket
import ssl
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import NamedTuple

from forefeel.common.clock import now_utc
from forefeel.common.errors import EndpointError
from forefeel.common.transport.endpoints import address, parts
from forefeel.common.transport.security import PartyFiles

TIMEOUT_S = 2.0
"""Each step of a probe takes at most as long: an end that needs more counts as silent."""
_REFUSAL_S = 0.2
"""With TLS 1.3 our handshake is done before the other end has seen our certificate. It refuses it within a
round trip, and what it takes to check it."""

# Why OpenSSL does not accept a certificate: X509_V_ERR_*.
_EXPIRED, _NOT_YET_VALID = 10, 9
_OTHER_NAME = frozenset({62, 64})
_OTHER_AUTHORITY = frozenset({2, 7, 18, 19, 20, 21})


class Obstacle(NamedTuple):
    """What is in the way, and what to do. `silent`: that the other end does not answer, for however long."""

    what: str
    advice: str
    silent: bool = False


@dataclass(frozen=True, slots=True)
class Reached:
    """What became of a probe. `connect_s`: of TCP, one round trip; `handshake_s`: of TLS; None: not done.
    `tried`: False where the protocol can not be tried like this.
    """

    endpoint: str
    tried: bool = True
    connect_s: float | None = None
    handshake_s: float | None = None
    obstacle: Obstacle | None = None


def reach(endpoint: str, identity: PartyFiles | None, other: str, timeout_s: float = TIMEOUT_S) -> Reached:
    """Blocks for some seconds at most, and never raises for what the network does.

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
            handshake_s = _shake_hands(plain, host, _trusting(identity), connect_s)
            return Reached(endpoint, connect_s=connect_s, handshake_s=handshake_s)
    except EndpointError:
        return Reached(endpoint, tried=False)
    except ssl.SSLCertVerificationError as error:
        expiry = partial(_expiry, host, port, identity, timeout_s)
        return Reached(endpoint, connect_s=connect_s, obstacle=_theirs(error, endpoint, host, expiry))
    except (OSError, ValueError) as error:  # ValueError: of a name that can not be one
        return Reached(endpoint, connect_s=connect_s, obstacle=_obstacle(error, endpoint, other, connect_s))


def _trusting(identity: PartyFiles) -> ssl.SSLContext:
    """What Zenoh asks for: our authority, the name under which we connect, and our certificate to show."""
    context = ssl.create_default_context(cafile=str(identity.authority))
    context.load_cert_chain(str(identity.certificate), str(identity.key))
    return context


def _shake_hands(plain: socket.socket, host: str, context: ssl.SSLContext, round_trip_s: float) -> float:
    """How long the handshake took. Raises OSError for whatever is wrong."""
    start_s = time.monotonic()
    with context.wrap_socket(plain, server_hostname=host) as secured:
        handshake_s = time.monotonic() - start_s
        secured.settimeout(_REFUSAL_S + 2.0 * round_trip_s)
        with suppress(TimeoutError):
            secured.recv(1)
        with suppress(OSError):
            secured.unwrap()
    return handshake_s


def _expiry(host: str, port: int, identity: PartyFiles | None, timeout_s: float) -> datetime | None:
    """When the certificate expired that was not accepted. Only a connection that takes any one shows it."""
    from cryptography import x509  # noqa: PLC0415 - only then

    if identity is None:
        return None
    context = _trusting(identity)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with suppress(OSError, ValueError), socket.create_connection((host, port), timeout_s) as plain:
        with context.wrap_socket(plain) as secured:
            shown = secured.getpeercert(binary_form=True)
        if shown is not None:
            return x509.load_der_x509_certificate(shown).not_valid_after_utc
    return None


def _theirs(
    error: ssl.SSLCertVerificationError, endpoint: str, host: str, expiry: Callable[[], datetime | None]
) -> Obstacle:
    whose, code = f"the certificate of {address(endpoint)}", error.verify_code
    if code == _EXPIRED:
        then = expiry()
        at = "" if then is None else f" {when(then, now_utc())}"
        return Obstacle(
            f"{whose} expired{at}", "forefeel pki init DIR renews it; copy it there, start that end anew"
        )
    if code == _NOT_YET_VALID:
        return Obstacle(f"{whose} is not valid yet", "compare date -u on both hosts")
    if code in _OTHER_NAME:
        return Obstacle(
            f"{whose} does not name {host}", "forefeel pki init DIR --hosts ROLE=ADDRESS, copy it there"
        )
    if code in _OTHER_AUTHORITY:
        return Obstacle(f"{whose} is of another authority", "both hosts need those of one forefeel pki init")
    return Obstacle(
        f"{whose} is not accepted ({error.verify_message})", "compare forefeel pki show on both hosts"
    )


def _obstacle(error: Exception, endpoint: str, other: str, connect_s: float | None) -> Obstacle:
    where = address(endpoint)
    match error:
        case TimeoutError() if connect_s is None:
            return Obstacle(f"no answer from {where}", "check cable, address and firewall", silent=True)
        case TimeoutError():
            what = f"{where} accepts the connection and says nothing"
            return Obstacle(what, f"look whether the {other} there hangs", silent=True)
        case ConnectionRefusedError():
            what, advice = f"{where} refuses the connection", f"start the {other} there"
        case ssl.SSLError() if "_ALERT_" in (error.reason or ""):
            what = f"{where} refuses our certificate ({_words(error).partition(' alert ')[2]})"
            advice = "compare forefeel pki show and date -u on both hosts"
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


def when(then: datetime, now: datetime) -> str:
    """A date that has passed, in words: today at 10:03 UTC, yesterday, on 2026-01-31."""
    days = (now.date() - then.date()).days
    if days == 0:
        return f"today at {then:%H:%M} UTC"
    return "yesterday" if days == 1 else f"on {then:%Y-%m-%d}"
