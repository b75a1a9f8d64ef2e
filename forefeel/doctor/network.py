"""Does the router or the peer answer within 2 s, and does it take our certificate?"""

import errno
import socket
from collections.abc import Sequence
from dataclasses import dataclass

from forefeel.common.errors import EndpointError
from forefeel.common.transport.endpoints import parts
from forefeel.doctor.findings import Finding
from forefeel.reachability import TIMEOUT_S, Reached

GROUP = "network"


def judge_reached(found: Reached) -> Finding:
    """Green: reached; amber: could not be tried; red: not reached."""
    if not found.tried:
        what = "can not be tried from here: only tcp/ and tls/ are"
        advice = "start the daemon: it says what it waits for"
        return Finding(GROUP, found.endpoint, "amber", what, advice)
    if found.obstacle is not None:
        what, advice, silent = found.obstacle
        return Finding(
            GROUP, found.endpoint, "red", f"{what} within {TIMEOUT_S:g} s" if silent else what, advice
        )
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
    try:
        protocol, host, port = parts(endpoint)
    except EndpointError:
        return Bound(endpoint, errno.EINVAL)
    kind = socket.SOCK_STREAM if protocol in {"tcp", "tls"} else socket.SOCK_DGRAM
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
