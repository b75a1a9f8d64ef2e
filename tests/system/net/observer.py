"""What a test sees of a running slave: `python -m tests.system.net.observer CELL AXIS WAY ENDPOINT PKI`.

Each state of the slave as a JSON line on the standard output, with the instant of its arrival.
"""

import json
import os
import sys
import threading

from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock
from forefeel.common.messages import SlaveState
from forefeel.common.topics import SLAVE_STATE
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.system.net.recorder import NICE, onlooker


def main() -> None:
    cell, axis, *way = sys.argv[1:]
    clock, ended = MonotonicClock(), threading.Event()
    os.nice(NICE)
    party = Party("viewer", (cell,))
    transport = ZenohTransport.open(onlooker(*way), clock, lambda _error: ended.set(), party)

    def seen(state: SlaveState, receive_ns: int) -> None:
        words = {
            "at_s": receive_ns * 1e-9,
            "state": state.state.value,
            "session": state.session_id,
            "position_m": state.position_m,
            "velocity_m_s": state.velocity_m_s,
        }
        os.write(1, (json.dumps(words) + "\n").encode())

    Bus(transport, cell, axis, clock).subscribe(SLAVE_STATE, seen)
    ended.wait()
    sys.exit(1)


if __name__ == "__main__":
    main()
