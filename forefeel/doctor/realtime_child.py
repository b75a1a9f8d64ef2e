"""The process that `forefeel.doctor.realtime` starts: a 1 kHz loop that does nothing, its figures as JSON."""

# ruff: noqa: E402 - first of all it ends with its parent, for on a busy host the imports take seconds
from forefeel.parent import die_with_parent

die_with_parent()

import json
import sys
import time

from forefeel.common.clock import MonotonicClock
from forefeel.common.runtime.realtime import RealtimeThread, prepare_process
from forefeel.common.settings import TICK_NS


def main(priority: int, seconds: float) -> dict[str, object]:
    """Runs it."""
    memory = prepare_process()
    failures: list[BaseException] = []
    thread = RealtimeThread("doctor", TICK_NS, lambda _now_ns: None, MonotonicClock(), failures.append)
    thread.start(priority)
    time.sleep(seconds)
    thread.stop()
    lateness = thread.lateness
    return {
        "scheduling": thread.scheduling,
        "memory": memory,
        "ticks": lateness.ticks,
        "missed": lateness.missed,
        "p50_us": lateness.quantile_us(0.5),
        "p99_us": lateness.quantile_us(0.99),
        "max_us": lateness.max_us,
    }


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), float(sys.argv[2]))))
