"""The file of a channel, written as the kernel would answer, with noise and faults."""

import time
from contextlib import ExitStack

from forefeel.devices.emulation.bench import NOISE_N, Emulation, Surroundings, felt
from forefeel.devices.emulation.sensing import FAULTS, EmulatedSensor, Sensing
from forefeel_iio.settings import IioSettings

_PERIOD_S = 0.001  # s, as often as the driver could ask


class EmulatedChannel:
    """Measures at each step and puts the counts into the file."""

    faults = (*FAULTS, "unplug", "plug")

    def __init__(self, settings: IioSettings, around: Surroundings, leave: ExitStack) -> None:
        sensing = Sensing(1.0 / _PERIOD_S, settings.full_scale_n, NOISE_N, seed=around.seed)
        self._sensor = EmulatedSensor(sensing, felt(around, settings.sign, leave))
        self._settings, self._plugged = settings, True
        leave.callback(settings.file.unlink, missing_ok=True)
        self.step()

    def provoke(self, fault: str) -> None:
        """`stuck`, `overrange` and `free` are of the cell; `unplug` takes the file away until `plug`."""
        if fault in ("unplug", "plug"):
            self._plugged = fault == "plug"
        else:
            self._sensor.provoke(fault)

    def step(self) -> None:
        """One conversion; the file is replaced at once, so that no reader meets half of it."""
        s = self._settings
        if self._plugged:
            counts = round(s.zero_counts + self._sensor.measure(time.monotonic()) / s.newton_per_count)
            fresh = s.file.with_suffix(".new")
            fresh.write_text(f"{counts}\n", encoding="ascii")
            fresh.replace(s.file)
        else:
            s.file.unlink(missing_ok=True)
        time.sleep(_PERIOD_S)


EMULATION = Emulation(
    {"newton_per_count": 5e-6, "zero_counts": 84_000, "full_scale_n": 10.0},
    EmulatedChannel,
    faults=FAULTS,
    port_key="file",
)
