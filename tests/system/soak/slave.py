"""The slave with a load cell that says NaN between one SIGUSR1 and the next:
`python -m tests.system.soak.slave SETTINGS`.
"""

import signal
import sys
from math import nan
from pathlib import Path

from forefeel.common.config import load_settings
from forefeel.daemons import run_daemon
from forefeel.devices.simulated.driver import SimulatedLoadCell
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.settings import SlaveSettings


def main() -> None:
    signals: list[int] = []
    signal.signal(signal.SIGUSR1, lambda number, _: signals.append(number))
    read = SimulatedLoadCell.read

    def read_or_nan(
        self: SimulatedLoadCell, now_ns: int, recording_time_s: float | None
    ) -> tuple[LoadCellReading]:
        (reading,) = read(self, now_ns, recording_time_s)
        return (reading._replace(force_n=nan) if len(signals) % 2 else reading,)

    SimulatedLoadCell.read = read_or_nan  # type: ignore[method-assign]
    run_daemon(load_settings(SlaveSettings, Path(sys.argv[1])))


if __name__ == "__main__":
    main()
