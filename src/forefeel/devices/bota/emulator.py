"""An emulated Bota six-axis cell: frames at its own rate, from the moment it has power. Pure."""

from contextlib import ExitStack
from math import nan
from pathlib import Path

from forefeel.devices.bota.protocol import OVERRANGE, BotaFrame, encode
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.emulation.bench import Emulation, SerialBench, Surroundings, sensor_of
from forefeel.devices.emulation.sensing import FAULTS, EmulatedSensor

_WRAP_US = 1 << 32  # us after which the clock in a frame, a u32, begins anew
_AT_REST = BotaFrame(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 25.0)


class EmulatedBota:
    """A Bota cell in run mode. The force that is felt is `component`; the others are zero."""

    faults = (*FAULTS, "nan")

    def __init__(self, sensor: EmulatedSensor, component: str = "fz") -> None:
        self._sensor, self._field = sensor, f"{component}_n"
        self._broken = False

    def receive(self, data: bytes, t_s: float) -> None:
        """Ignores the bytes: a cell in run mode does not listen."""

    def advance(self, t_s: float) -> bytes:
        return b"".join(encode(self._frame(*measured)) for measured in self._sensor.due(t_s))

    def provoke(self, fault: str) -> None:
        """Begins `stuck`, `overrange` or `nan` (forces that are no numbers); `free` ends it."""
        self._broken = fault == "nan"
        if not self._broken:
            self._sensor.provoke(fault)

    def clock_us(self, t_s: float) -> int:
        return int(t_s * 1e6)

    def _frame(self, t_s: float, force_n: float) -> BotaFrame:
        status = OVERRANGE if self._sensor.saturated else 0
        force = {self._field: nan if self._broken else force_n}
        return _AT_REST._replace(status=status, t_us=self.clock_us(t_s) % _WRAP_US, **force)


def build(settings: BotaSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    device = EmulatedBota(sensor_of(settings, around, leave), settings.component)
    return SerialBench(device, Path(settings.port), settings.baud)


EMULATION = Emulation({"full_scale_n": 10.0}, build)
