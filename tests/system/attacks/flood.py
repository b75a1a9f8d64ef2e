"""Puts one payload again and again: `python -m tests.system.attacks.flood ENDPOINT KEY RATE SECONDS`.

The payloads come on standard input, one in hexadecimal a line; how many were put goes to standard output.
"""

import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import zenoh

from tests.live_cell import ROOT
from tests.system.attacks.stranger import stranger
from tests.waiting import wait_until

_BATCH_S = 0.001


def flood(endpoint: str, key: str, rate_hz: float, duration_s: float, payloads: Sequence[bytes]) -> int:
    """Runs it as a process of its own; how many it put."""
    command = [
        sys.executable,
        "-m",
        "tests.system.attacks.flood",
        endpoint,
        key,
        str(rate_hz),
        str(duration_s),
    ]
    lines = "\n".join(payload.hex() for payload in payloads)
    done = subprocess.run(
        command, input=lines, capture_output=True, text=True, cwd=ROOT, timeout=duration_s + 60, check=True
    )
    return int(done.stdout)


def main() -> None:
    """Puts at that rate, or as fast as it goes where that is slower."""
    endpoint, key, rate_hz, duration_s = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4])
    payloads = [bytes.fromhex(line) for line in sys.stdin.read().split()]
    with stranger(endpoint) as attacker:
        wait_until(lambda: attacker.connected, 10.0, "connected")
        publisher: Any = attacker.session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        time.sleep(0.3)
        print(_put(publisher, rate_hz, duration_s, payloads))
        publisher.undeclare()


def _put(publisher: zenoh.Publisher, rate_hz: float, duration_s: float, payloads: Sequence[bytes]) -> int:
    start_s, done, kinds = time.monotonic(), 0, len(payloads)
    while (elapsed_s := time.monotonic() - start_s) < duration_s:
        due = min(int(elapsed_s * rate_hz), done + 1000)
        for i in range(done, due):
            publisher.put(payloads[i % kinds])
        if due == done:
            time.sleep(_BATCH_S)
        done = due
    return done


if __name__ == "__main__":
    main()
