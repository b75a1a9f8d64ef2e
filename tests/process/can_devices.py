"""A device process: an emulated drive on its own slcan adapter; prints its state over and over."""

import sys
import time

from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.settings import CanSettings
from tests.devices.can_rig import drive_on
from tests.witness import go_ahead


def main() -> None:
    """Arguments: the adapter's path."""
    go_ahead()
    drive = drive_on(open_bus(CanSettings(interface="slcan", channel=sys.argv[1])))
    next_s = 0.0
    while True:
        drive.step()
        if time.monotonic() > next_s:
            next_s = time.monotonic() + 0.005
            model = drive.model
            print(f"{time.monotonic():.6f} {model.state.name} {model.position_m:.9f}", flush=True)


if __name__ == "__main__":
    main()
