"""A daemon whose clock can be made wrong: `python -m tests.system.net.steered STEP_S RATE COMMAND...`.

Runs `forefeel COMMAND...`. At SIGUSR1 the clock that the daemon and its drivers read goes on or back by
STEP_S, and from then on it gains RATE seconds per second. The machine's clock is left alone.
"""

import signal
import sys
import time
from dataclasses import dataclass

from forefeel.__main__ import main as run_command_line
from forefeel.common.clock import MonotonicClock
from forefeel.common.error_size import Floats


@dataclass(frozen=True, slots=True)
class Steering:
    """How a clock departs from the host's: by `step_s` at once, then by `rate` s per second."""

    step_s: float = 0.0
    rate: float = 0.0

    def begin(self) -> None:
        """Lets every clock of this process depart from now on."""
        from_ns, step_ns = time.monotonic_ns(), round(self.step_s * 1e9)

        def shown_ns() -> int:
            host_ns = time.monotonic_ns()
            return host_ns + step_ns + round((host_ns - from_ns) * self.rate)

        MonotonicClock.read_ns = staticmethod(shown_ns)

    def host_s(self, shown_s: Floats, from_s: float) -> Floats:
        """When a clock that began to depart at `from_s` showed that, in s."""
        return from_s + (shown_s - self.step_s - from_s) / (1.0 + self.rate)


def main() -> None:
    steering = Steering(float(sys.argv.pop(1)), float(sys.argv.pop(1)))
    signal.signal(signal.SIGUSR1, lambda *_: steering.begin())
    run_command_line()


if __name__ == "__main__":
    main()
