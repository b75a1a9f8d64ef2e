"""The file of a channel, written as the kernel would answer, with noise and faults."""

import os
import time
from contextlib import ExitStack

from forefeel.devices.emulation.bench import Emulation, Surroundings, sensor_of
from forefeel.devices.emulation.sensing import FAULTS
from forefeel_iio.settings import IioSettings

_PERIOD_S = 0.002  # s, as often as the driver may ask


class EmulatedChannel:
    """Measures at each step and puts the counts into the file."""

    faults = (*FAULTS, "unplug", "plug")

    def __init__(self, settings: IioSettings, around: Surroundings, leave: ExitStack) -> None:
        self._sensor = sensor_of(settings, around, leave)
        self._settings, self._file = settings, settings.file.open("wb", buffering=0)
        self._now_s = around.now_s
        leave.callback(self._close)
        self._write()

    def provoke(self, fault: str) -> None:
        """`stuck`, `overrange` and `free` are of the cell; `unplug` takes the file away until `plug`."""
        if fault == "unplug":
            self._settings.file.unlink(missing_ok=True)
        elif fault == "plug":
            self._file.close()
            self._file = self._settings.file.open("wb", buffering=0)
        else:
            self._sensor.provoke(fault)

    def step(self, wait_s: float = _PERIOD_S) -> None:
        """One conversion."""
        self._write()
        if wait_s:
            time.sleep(wait_s)

    def _close(self) -> None:
        self.provoke("unplug")
        self._file.close()

    def _write(self) -> None:
        """In place and at once, so that no reader meets half a number, and no disk has to be waited for."""
        s = self._settings
        counts = round(s.zero_counts + self._sensor.measure(self._now_s()) / s.newton_per_count)
        os.pwrite(self._file.fileno(), b"%11d\n" % counts, 0)


EMULATION = Emulation(
    {"newton_per_count": 5e-6, "zero_counts": 84_000, "full_scale_n": 10.0}, EmulatedChannel, port_key="file"
)
