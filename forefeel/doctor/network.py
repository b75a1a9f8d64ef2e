"""Does the router or the peer answer within 2 s, and does it take our certificate?"""

import errno
import re
import socket
import ssl
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from forefeel.doctor.findings import Finding

GROUP = "network"
TIMEOUT_S = 2.0
_REFUSAL_S = 0.2
_FORM = re.compile(r"(?P<protocol>\w+)/(?P<host>\[[^\]]+\]|[^:/?#]+):(?P<port>\d+)")


@dataclass(frozen=True, slots=True)
class Files:
    """What a TLS handshake needs: authority, certificate, key."""

    authority: str
    certificate: str
    key: str


@dataclass(frozen=True, slots=True)
class Reached:
    """What became of a connection. `connect_s`: of TCP, one round trip; `handshake_s`: of TLS; None: not
    done. `tried`: False where the protocol can not be tried like this.
    """

    endpoint: str
    tried: bool = True
    connect_s: float | None = None
    handshake_s: float | None = None
    error: str = ""


def reach(endpoint: str, files: Files | None, timeout_s: float = TIMEOUT_S) -> Reached:
    """Connects, shakes hands and hangs up; never raises for what the network does."""
    form = _FORM.match(endpoint)
    if form is None or form["protocol"] not in {"tcp", "tls"}:
        return Reached(endpoint, tried=False)
    host, port = form["host"].strip("[]"), int(form["port"])
    start_s = time.monotonic()
    try:
        with socket.create_connection((host, port), timeout_s) as plain:
            connect_s = time.monotonic() - start_s
            if form["protocol"] == "tcp":
                return Reached(endpoint, connect_s=connect_s)
            return _shake_hands(endpoint, host, plain, files, connect_s)
    except OSError as error:
        return Reached(endpoint, error=_reason(error, timeout_s))


def _shake_hands(
    endpoint: str, host: str, plain: socket.socket, files: Files | None, connect_s: float
) -> Reached:
    start_s = time.monotonic()
    try:
        context = ssl.create_default_context(cafile=files.authority if files else None)
        if files is not None:
            context.load_cert_chain(files.certificate, files.key)
        with context.wrap_socket(plain, server_hostname=host) as secured:
            handshake_s = time.monotonic() - start_s
            # With TLS 1.3 the other end refuses our certificate only after our handshake is done.
            secured.settimeout(_REFUSAL_S)
            with suppress(TimeoutError):
                secured.recv(1)
            return Reached(endpoint, connect_s=connect_s, handshake_s=handshake_s)
    except OSError as error:  # an SSLError is one
        return Reached(endpoint, connect_s=connect_s, error=_reason(error, plain.gettimeout() or TIMEOUT_S))


def _reason(error: OSError, timeout_s: float) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not accepted: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        word = (error.reason or str(error)).lower().replace("_", " ")
        return f"the handshake failed: {word}"
    if isinstance(error, TimeoutError):
        return f"no answer within {timeout_s:g} s"
    return error.strerror or str(error)


def judge_reached(found: Reached) -> Finding:
    """Green: reached; amber: could not be tried; red: not reached."""
    if not found.tried:
        what = "can not be tried from here: only tcp/ and tls/ are"
        advice = "start the daemon: it says what it waits for"
        return Finding(GROUP, found.endpoint, "amber", what, advice)
    if found.error:
        secured = found.connect_s is not None
        advice = (
            "certificates of one forefeel pki init on both hosts, with this host name in the other end's"
            if secured
            else "start the router or the other end; check address, port and firewall"
        )
        return Finding(GROUP, found.endpoint, "red", found.error, advice)
    assert found.connect_s is not None
    tls = "" if found.handshake_s is None else f", TLS handshake {found.handshake_s * 1e3:.1f} ms"
    return Finding(GROUP, found.endpoint, "green", f"answers, round trip {found.connect_s * 1e3:.2f} ms{tls}")


@dataclass(frozen=True, slots=True)
class Bound:
    """Whether an endpoint can be listened on: error number of the attempt, 0 where it can."""

    endpoint: str
    error: int


def try_listen(endpoint: str) -> Bound:
    """Binds the endpoint's address for a moment."""
    form = _FORM.match(endpoint)
    if form is None:
        return Bound(endpoint, errno.EINVAL)
    host, port = form["host"].strip("[]"), int(form["port"])
    kind = socket.SOCK_STREAM if form["protocol"] in {"tcp", "tls"} else socket.SOCK_DGRAM
    try:
        found = socket.getaddrinfo(host, port, type=kind)[0]
        with socket.socket(found[0], kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(found[4])
    except OSError as error:
        return Bound(endpoint, error.errno or errno.EINVAL)
    return Bound(endpoint, 0)


def judge_listen(found: Bound, running: bool) -> Finding:
    """`running`: the daemon of these settings runs on this host."""
    subject = f"listen {found.endpoint}"
    if found.error == 0:
        return Finding(GROUP, subject, "green", "free")
    if found.error == errno.EADDRINUSE and running:
        return Finding(GROUP, subject, "green", "taken by the daemon that runs")
    if found.error == errno.EADDRINUSE:
        return Finding(
            GROUP, subject, "amber", "taken", "end the program that has it, or choose another port"
        )
    advice = "listen on an address of this host, or on 0.0.0.0 for all"
    return Finding(GROUP, subject, "red", errno.errorcode.get(found.error, str(found.error)), advice)


def judge_endpoints(listen: Sequence[str], connect: Sequence[str]) -> list[Finding]:
    """A finding where a daemon has nobody to speak to."""
    if listen or connect:
        return []
    return [Finding(GROUP, "endpoints", "red", "none", "name one in transport.listen or transport.connect")]
