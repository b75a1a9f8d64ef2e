"""An emulated Bota six-axis cell: frames at its own rate, from the moment it has power. Pure."""

from collections.abc import Callable
from contextlib import ExitStack
from math import floor, nan
from pathlib import Path

from forefeel.devices.bota.protocol import OVERRANGE, BotaFrame, encode
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.emulation.bench import (
    NOISE_N,
    Emulation,
    SerialBench,
    Surroundings,
    felt,
)
from forefeel.devices.emulation.sensing import FAULTS, EmulatedSensor, Sensing

RATE_HZ = 800.0  # Hz, frames of the emulated cell, the default of `BotaSettings.rate_hz`
_US_PER_S = 1_000_000  # us in a second
_WRAP_US = 1 << 32  # us after which the clock in a frame, a u32, begins anew


class EmulatedBota:
    """A Bota cell in run mode. The force that is felt is `component`; the others are noise.

    Its clock is `drift_ppm` fast and begins at `start_us`; `status` is set in every frame.
    """

    faults = (*FAULTS, "nan")

    def __init__(
        self,
        feel: Callable[[float], float],
        sensing: Sensing | None = None,
        component: str = "fz",
        status: int = 0,
        start_us: int = 0,
        drift_ppm: float = 0.0,
    ) -> None:
        self.sensing = sensing or Sensing(RATE_HZ)
        self.status = status
        self._sensor = EmulatedSensor(self.sensing, feel)
        quiet = Sensing(self.sensing.rate_hz, noise_n=self.sensing.noise_n, seed=self.sensing.seed + 1)
        self._others = EmulatedSensor(quiet, lambda _: 0.0)
        self._field = f"{component}_n"
        self._start_us, self._pace = start_us, 1.0 + drift_ppm * 1e-6
        self._broken = False
        self.sent = 0
        self._resting = BotaFrame(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 25.0)

    def receive(self, data: bytes, t_s: float) -> None:
        """Ignores the bytes: a cell in run mode does not listen."""

    def advance(self, t_s: float) -> bytes:
        found = b""
        while (made_s := self.made_s(self.sent)) <= t_s:
            found += encode(self._frame(made_s))
            self.sent += 1
        return found

    def made_s(self, number: int) -> float:
        """When it measures the frame of that number, the first being 0."""
        return (number + 1) / self.sensing.rate_hz

    def provoke(self, fault: str) -> None:
        """Begins `stuck`, `overrange` or `nan` (forces that are no numbers); `free` ends it."""
        self._broken = fault == "nan"
        if not self._broken:
            self._sensor.provoke(fault)

    def reset(self) -> None:
        """Lets its clock begin anew, as after a loss of power."""
        self._start_us = -floor(self.made_s(self.sent) * self._pace * _US_PER_S)

    def _frame(self, t_s: float) -> BotaFrame:
        force_n = nan if self._broken else self._sensor.measure(t_s)
        status = self.status | (OVERRANGE if self._sensor.saturated else 0)
        others = {name: self._others.measure(t_s) for name in BotaFrame._fields[1:7]}
        others[self._field] = force_n
        t_us = (self._start_us + floor(t_s * self._pace * _US_PER_S)) % _WRAP_US
        return self._resting._replace(status=status, t_us=t_us, **others)


def build(settings: BotaSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """Builds the six-axis cell on the stage for `Emulation`."""
    sensing = Sensing(settings.rate_hz, full_scale_n=settings.full_scale_n, noise_n=NOISE_N, seed=around.seed)
    device = EmulatedBota(felt(around, settings.sign, leave), sensing, settings.component)
    return SerialBench(device, Path(settings.port), settings.baud)


EMULATION = Emulation({"full_scale_n": 10.0}, build)
