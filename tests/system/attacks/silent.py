"""Opens TCP connections and says nothing: `python -m tests.system.attacks.silent HOST PORT COUNT`.

It prints how many stand once no further one comes, and holds them until it is ended.
"""

import resource
import socket
import sys
import time
from contextlib import suppress

_AT_ONCE = 250
_PAUSE_S = 0.01
"""After so many, so that it is the connections that are tried here and not the processor."""


def main() -> None:
    """Opens as many as the limits of this process and the other end give."""
    host, port, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    connections = [socket.create_connection((host, port))]
    with suppress(OSError):  # no descriptor or port is left
        while len(connections) < count:
            connections.append(socket.socket())
            connections[-1].setblocking(False)
            connections[-1].connect_ex((host, port))
            if len(connections) % _AT_ONCE == 0:
                time.sleep(_PAUSE_S)
    print(f"{len(connections)} connections", flush=True)
    time.sleep(600.0)  # for somebody who forgets to end it


if __name__ == "__main__":
    main()
