"""Zenoh endpoints, checked beforehand because Zenoh retries a misspelt one for ever in silence."""

import re
import socket

from forefeel.common.errors import EndpointError

_FORM = re.compile(
    r"(?P<protocol>tcp|tls|quic|udp)/(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^\s:/?#\[\]]+):(?P<port>\d{1,5})"
    r"(?:\?[^#\s]*)?(?:#\S*)?"
)


def check_endpoint(endpoint: str) -> None:
    """Checks that an endpoint can work on this host.

    Raises:
        EndpointError: malformed, or its host name does not resolve.
    """
    _, host, port = parts(endpoint)
    try:
        socket.getaddrinfo(host, port)
    except (socket.gaierror, UnicodeError) as error:
        raise EndpointError(
            f"endpoint {endpoint!r}: host {host!r} does not resolve; check its spelling or give an IP address"
        ) from error


def parts(endpoint: str) -> tuple[str, str, int]:
    """Protocol, host without brackets, and port of an endpoint.

    Raises:
        EndpointError: malformed.
    """
    form = _FORM.fullmatch(endpoint)
    if form is None or not 0 < int(form["port"]) < 65536:
        raise EndpointError(
            f"endpoint {endpoint!r}: expected protocol/host:port as in tcp/192.0.2.7:7447, "
            "the protocol one of tcp, tls, quic, udp, the port 1 to 65535"
        )
    return form["protocol"], form["host"].strip("[]"), int(form["port"])


def address(endpoint: str) -> str:
    return re.split("[?#]", endpoint.partition("/")[2])[0]


def explain(error: str, listen: tuple[str, ...], connect: tuple[str, ...]) -> str:
    """Text for the user, in one line, from Zenoh's error at opening: the endpoint, the reason, what to do."""
    at = next((repr(endpoint) for endpoint in listen if address(endpoint) in error), _all(listen))
    if "Address already in use" in error:
        return f"endpoint {at}: taken by another program; end that one or listen on another port"
    if "Cannot assign requested address" in error:
        return f"endpoint {at}: no address of this host; listen on one of its own, or on 0.0.0.0 for all"
    if "Permission denied" in error:
        return f"endpoint {at}: not permitted; listen on a port above 1023"
    if "Unable to connect" in error:
        return f"endpoint {_all(connect)}: no router answers; start it first"
    reason = error.partition(" at /")[0].rstrip(". ")
    return f"endpoint {_all(listen + connect)}: {reason}; check certificates and keys"


def _all(endpoints: tuple[str, ...]) -> str:
    return ", ".join(repr(endpoint) for endpoint in endpoints)
