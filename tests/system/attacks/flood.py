"""Puts payloads again and again: `python -m tests.system.attacks.flood ENDPOINT KEY RATE_HZ SECONDS`.

The payloads come on standard input, one in hexadecimal a line; how many were put goes to standard output.
"""

import sys
import time
from typing import Any

import zenoh

from tests.secured import connected, sessions
from tests.waiting import wait_until

_BATCH_S = 0.001


def main() -> None:
    """Puts at that rate, or as fast as it goes where that is slower."""
    endpoint, key, rate_hz, duration_s = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4])
    payloads = [bytes.fromhex(line) for line in sys.stdin.read().split()]
    with sessions() as network:
        session = network.attacker(endpoint)
        wait_until(lambda: connected(session), 10.0, "connected")
        publisher: Any = session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        time.sleep(0.3)
        start_s, done = time.monotonic(), 0
        while (elapsed_s := time.monotonic() - start_s) < duration_s:
            due = min(int(elapsed_s * rate_hz), done + 1000)
            for i in range(done, due):
                publisher.put(payloads[i % len(payloads)])
            if due == done:
                time.sleep(_BATCH_S)
            done = due
        print(done)
        publisher.undeclare()


if __name__ == "__main__":
    main()
