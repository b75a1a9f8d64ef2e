"""A daemon whose clock can be set: `python -m tests.net.stepped SECONDS COMMAND...`.

Runs `forefeel COMMAND...`. At SIGUSR1 the clock that the daemon and its drivers read goes on or back by that
many seconds. The machine's clock is left alone.
"""

import signal
import sys
import time

from common.clock import MonotonicClock
from forefeel.__main__ import main as run_command_line

_STEP_NS = [0]


def _now_ns(clock: MonotonicClock) -> int:
    del clock
    return time.monotonic_ns() + _STEP_NS[0]


def _sleep_until_ns(clock: MonotonicClock, deadline_ns: int) -> None:
    remaining_ns = deadline_ns - _now_ns(clock)
    if remaining_ns > 0:
        time.sleep(remaining_ns * 1e-9)


def main() -> None:
    """See the module."""
    step_ns = round(float(sys.argv.pop(1)) * 1e9)
    for method in (_now_ns, _sleep_until_ns):  # of every clock of the process, whoever made it
        setattr(MonotonicClock, method.__name__.removeprefix("_"), method)
    signal.signal(signal.SIGUSR1, lambda *_: _STEP_NS.__setitem__(0, step_ns))
    run_command_line()


if __name__ == "__main__":
    main()
