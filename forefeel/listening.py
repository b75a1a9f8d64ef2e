"""Where a page is served: a socket that listens before the server is there, also the parent's."""

import os
import socket

from forefeel.common.errors import EndpointError

INHERITED = "FOREFEEL_LISTENING"
"""The number of a descriptor that the parent left open: a socket that listens already."""
# connections that the kernel keeps before they are accepted (listen(2)); chosen, not measured: pages that
# open during the start wait there
BACKLOG = 64


def listening_at(address: str, port: int) -> socket.socket:
    """The parent's where there is one, else a new one.

    Raises:
        EndpointError: the port is taken, or not at this host.
    """
    inherited = os.environ.pop(INHERITED, None)
    if inherited is not None:
        return socket.socket(fileno=int(inherited))
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        return socket.create_server((address, port), family=family, backlog=BACKLOG)
    except OSError as error:
        reason = str(error.strerror).partition(" (")[0]  # Python adds the address
        raise EndpointError(f"--port {port} at {address}: {reason}; expected a free one") from error
