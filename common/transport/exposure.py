"""Exposure of endpoints to a network: with certificates, or by a loud and limited consent."""

import ipaddress
from collections.abc import Sequence

from forefeel.common.errors import EndpointError

_SECURED = ("tls", "quic")
_OURS = frozenset({"iface", "bind", "dscp", "so_sndbuf", "so_rcvbuf"})
"""Options that may follow `#` in an endpoint; the rest that Zenoh reads there can undo its security."""
_FOLDER = "transport.pki (--pki), a copy of DIR/CELL/ROLE of `forefeel pki init DIR --cell CELL`"


def check_exposure(
    listen: Sequence[str], connect: Sequence[str], *, secured: bool, insecure: bool, real_stage: bool
) -> str:
    """Checks endpoints against certificates and consent; returns a warning, to be said loudly, where the
    traffic can be read and forged, else an empty text.

    Args:
        listen: endpoints, well-formed.
        connect: endpoints, well-formed.
        secured: certificates and access control are configured.
        insecure: the user consents to do without.
        real_stage: a stage that is not simulated is configured here.

    Raises:
        EndpointError: a plain endpoint beside certificates or a secured listener, a tls/ or quic/ one without
            certificates, or one outside this host without them where there is a real stage or no `insecure`.
    """
    _refuse_plain_beside_secured(listen, connect, secured)
    if secured:
        return ""
    for endpoint in filter(_is_secured, (*listen, *connect)):
        raise EndpointError(f"endpoint {endpoint!r}: needs certificates; expected {_FOLDER}")
    outside = [endpoint for endpoint in (*listen, *connect) if not on_loopback(endpoint)]
    if not outside:
        return ""
    if real_stage:
        raise EndpointError(
            f"endpoint {outside[0]!r}: a real stage and no certificates; expected tls/ and {_FOLDER}, "
            "or loopback endpoints only; --insecure does not help here"
        )
    if not insecure:
        raise EndpointError(
            f"endpoint {outside[0]!r}: outside this host without certificates; expected tls/ and {_FOLDER}, "
            "or --insecure"
        )
    return (
        f"INSECURE: {', '.join(outside)}: not encrypted, not authenticated; "
        "whoever reaches this network can read everything and command the stage"
    )


def _refuse_plain_beside_secured(listen: Sequence[str], connect: Sequence[str], secured: bool) -> None:
    """Raises EndpointError: with certificates (`secured`) for a plain endpoint, or for an option after `#`
    that is not one of `_OURS`, as it could undo them; without, for a plain listener beside a tls/ or quic/
    one.
    """
    plain = [endpoint for endpoint in listen if not _is_secured(endpoint)]
    if plain and (secured or len(plain) < len(listen)):
        raise EndpointError(
            f"endpoint {plain[0]!r}: a plain listener beside certificates; expected tls/ or quic/ only"
        )
    for endpoint in (*listen, *connect) if secured else ():
        if not _is_secured(endpoint):
            raise EndpointError(
                f"endpoint {endpoint!r}: plain, with certificates; expected tls/ or quic/ only"
            )
        options = [option.partition("=")[0] for option in endpoint.partition("#")[2].split(";") if option]
        if unknown := [option for option in options if option not in _OURS]:
            raise EndpointError(
                f"endpoint {endpoint!r}: {unknown[0]!r} after #; expected one of {', '.join(sorted(_OURS))}, "
                "certificates come from transport.pki"
            )


def on_loopback(endpoint: str) -> bool:
    """True if only this host can reach the endpoint.

    That is an address of the loopback network, or `localhost`. Any other name is taken as outside, for who
    answers for it may change.
    """
    host = endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host.lower() == "localhost"
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback


def _is_secured(endpoint: str) -> bool:
    return endpoint.partition("/")[0] in _SECURED
