"""A recorder beside a daemon: `python -m tests.system.net.recorder FILE CELL WAY ENDPOINT PKI`.

`WAY`: `listen` for a daemon, `connect` to one, or `client` of a router.

`forefeel record` connects, and again within a second after a daemon was started anew: in that second it hears
nothing. This one listens and hears the daemon's first word, or connects so soon that it hears the first word
of a session.
"""

import os
import sys
import time
from contextlib import closing
from pathlib import Path

from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_config import CONNECTING
from forefeel.interrupt import signal_flag
from forefeel.recorder import Recorder

_POLL_S = 0.1
_RETRY_MS = 100
"""A master opens no session so soon after it has begun to listen."""
NICE = -15
"""Behind the daemons, ahead of all else: a witness that gets no processor for a second loses its link.
Not under SCHED_FIFO: the kernel's own threads, which carry the bytes of a pty, would wait for it, too.
"""


def onlooker(way: str, endpoint: str, pki: str) -> TransportSettings:
    if way == "client":
        return TransportSettings(mode="client", connect=(endpoint,), pki=Path(pki))
    if way == "connect":
        CONNECTING["connect/retry"] = {"period_init_ms": _RETRY_MS, "period_max_ms": _RETRY_MS}
        return TransportSettings(connect=(endpoint,), pki=Path(pki))
    return TransportSettings(listen=(endpoint,), pki=Path(pki))


def main() -> None:
    out, cell, *way = sys.argv[1:]
    os.nice(NICE)
    recorder = Recorder(Path(out), cell, onlooker(*way), {"cell": cell}, Party("recorder", (cell,)))
    print("recording", flush=True)
    with signal_flag() as stop, closing(recorder):
        while not stop.wanted():
            recorder.check()
            time.sleep(_POLL_S)


if __name__ == "__main__":
    main()
