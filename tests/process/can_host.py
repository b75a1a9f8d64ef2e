"""A host process: opens a stage on slcan and moves it back and forth until it is killed."""

import sys
import time

from forefeel.common.clock import MonotonicClock
from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.cia402 import driver as drive_cycle
from forefeel.devices.cia402.driver import Cia402Stage
from tests.devices.can_rig import START_M, stage_settings
from tests.witness import go_ahead

HEARTBEAT_S = 0.3
"""A busy machine is silent for a tenth of a second and more."""


def main() -> None:
    """Arguments: the adapter's path."""
    go_ahead()
    drive_cycle.SILENT_S = 1.0  # only the drive has to notice a silence, and a busy machine makes some
    settings = CanSettings(interface="slcan", channel=sys.argv[1])
    stage = Cia402Stage(stage_settings(settings, heartbeat_s=HEARTBEAT_S))
    stage.open()
    start_s, clock = time.monotonic(), MonotonicClock()
    print("moving", flush=True)
    while True:
        phase = (time.monotonic() - start_s) % 1.0
        stage.command(START_M + 0.15 * min(phase, 1.0 - phase), 0.0, clock.now_ns())
        time.sleep(0.001)


if __name__ == "__main__":
    main()
