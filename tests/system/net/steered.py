"""A daemon whose clock can be made wrong: `python -m tests.system.net.steered STEP_S RATE COMMAND...`.

Runs `forefeel COMMAND...`. At SIGUSR1 the clock that the daemon and its drivers read goes on or back by
STEP_S, and from then on it gains RATE seconds per second. The machine's clock is left alone.
"""

import signal
import sys
import time
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from forefeel.__main__ import main as run_command_line
from forefeel.common.clock import MonotonicClock

Stamps = TypeVar("Stamps", float, NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class Steering:
    """How a clock departs from the host's: by `step_s` at once, then by `rate` s per second."""

    step_s: float = 0.0
    rate: float = 0.0

    @property
    def words(self) -> tuple[str, str]:
        return str(self.step_s), str(self.rate)

    def shown_ns(self, host_ns: int, from_ns: int) -> int:
        """What the clock shows at a later instant than `from_ns`, when it began to depart."""
        return host_ns + round(self.step_s * 1e9) + round((host_ns - from_ns) * self.rate)

    def host_s(self, shown_s: Stamps, from_s: float) -> Stamps:
        """When it showed that: the inverse, in s."""
        return from_s + (shown_s - self.step_s - from_s) / (1.0 + self.rate)

    def begin(self) -> None:
        """Every clock of this process departs from now on."""
        from_ns = time.monotonic_ns()
        MonotonicClock.read_ns = staticmethod(lambda: self.shown_ns(time.monotonic_ns(), from_ns))


def main() -> None:
    steering = Steering(float(sys.argv.pop(1)), float(sys.argv.pop(1)))
    signal.signal(signal.SIGUSR1, lambda *_: steering.begin())
    run_command_line()


if __name__ == "__main__":
    main()
