"""Zenoh endpoints, checked beforehand because Zenoh retries a misspelt one for ever in silence."""

import re
import socket

from common.errors import EndpointError

_FORM = re.compile(
    r"(?P<protocol>tcp|tls|quic|udp)/(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^\s:/?#\[\]]+):(?P<port>\d{1,5})"
    r"(?:\?[^#\s]*)?(?:#\S*)?"
)


def check_endpoint(endpoint: str) -> None:
    """Refuses an endpoint that can never work on this host.

    Raises:
        EndpointError: malformed, or its host name does not resolve.
    """
    form = _parsed(endpoint)
    if not 0 < int(form["port"]) < 65536:
        raise _malformed(endpoint)
    host = form["host"].strip("[]")
    try:
        socket.getaddrinfo(host, int(form["port"]))
    except (socket.gaierror, UnicodeError) as error:
        raise EndpointError(
            f"endpoint {endpoint!r}: host {host!r} does not resolve; check its spelling or give an IP address"
        ) from error


def port_of(endpoint: str) -> int:
    """Its port.

    Raises:
        EndpointError: malformed.
    """
    return int(_parsed(endpoint)["port"])


def shifted(endpoint: str, by: int) -> str:
    """The same endpoint on a port higher by that much.

    Raises:
        EndpointError: malformed.
    """
    form = _parsed(endpoint)
    return f"{endpoint[: form.start('port')]}{int(form['port']) + by}{endpoint[form.end('port') :]}"


def _parsed(endpoint: str) -> re.Match[str]:
    form = _FORM.fullmatch(endpoint)
    if form is None:
        raise _malformed(endpoint)
    return form


def _malformed(endpoint: str) -> EndpointError:
    return EndpointError(
        f"endpoint {endpoint!r}: expected protocol/host:port as in tcp/192.0.2.7:7447, "
        "the protocol one of tcp, tls, quic, udp, the port 1 to 65535"
    )


def explain(error: str, listen: tuple[str, ...], connect: tuple[str, ...]) -> str:
    """One line for what Zenoh said when it could not open: the endpoint, the reason, what to do."""
    at = next((repr(endpoint) for endpoint in listen if _address(endpoint) in error), _all(listen))
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


def _address(endpoint: str) -> str:
    return re.split("[?#]", endpoint.partition("/")[2])[0]


def _all(endpoints: tuple[str, ...]) -> str:
    return ", ".join(repr(endpoint) for endpoint in endpoints)
