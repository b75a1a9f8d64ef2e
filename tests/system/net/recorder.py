"""A recorder beside a daemon: `python -m tests.system.net.recorder FILE CELL WAY ENDPOINT PKI`.

`WAY`: `listen` for a daemon, `connect` to one, or `client` of a router. Each state of the slave is a JSON
line on the standard output, with the instant of its arrival.

`forefeel record` connects, and again within a second after a daemon was started anew: in that second it hears
nothing. This one listens and hears the daemon's first word, or connects so soon that it hears the first word
of a session.
"""

import json
import os
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Literal

from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock
from forefeel.common.messages import SlaveState
from forefeel.common.topics import SLAVE_STATE
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_config import CONNECTING
from forefeel.interrupt import signal_flag
from forefeel.recorder import Recorder

AXIS = "insertion"
_POLL_S = 0.1
_RETRY_MS = 100
"""A master opens no session so soon after it has begun to listen."""
_NICE = -15
"""Behind the daemons, ahead of all else: a witness that gets no processor for a second loses its link.
Not under SCHED_FIFO: the kernel's own threads, which carry the bytes of a pty, would wait for it, too.
"""


def main() -> None:
    out, cell, way, endpoint, pki = sys.argv[1:]
    os.nice(_NICE)
    if way == "listen":
        settings = TransportSettings(listen=(endpoint,), pki=Path(pki))
    else:
        CONNECTING["connect/retry"] = {"period_init_ms": _RETRY_MS, "period_max_ms": _RETRY_MS}
        mode: Literal["client", "peer"] = "client" if way == "client" else "peer"
        settings = TransportSettings(mode=mode, connect=(endpoint,), pki=Path(pki))
    recorder = Recorder(Path(out), cell, settings, {"cell": cell}, Party("recorder", (cell,)))
    Bus(recorder.transport, cell, AXIS, MonotonicClock()).subscribe(SLAVE_STATE, _show)
    print("recording", flush=True)
    with signal_flag() as stop, closing(recorder):
        while not stop.wanted():
            recorder.check()
            time.sleep(_POLL_S)


def _show(state: SlaveState, receive_ns: int) -> None:
    words = {
        "at_s": receive_ns * 1e-9,
        "state": state.state.value,
        "session": state.session_id,
        "position_m": state.position_m,
        "velocity_m_s": state.velocity_m_s,
    }
    os.write(1, (json.dumps(words) + "\n").encode())


if __name__ == "__main__":
    main()
