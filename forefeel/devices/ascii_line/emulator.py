"""Emulated load cells that print numbers: Loadstar's iLoad and an HX711 behind a microcontroller. Pure."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from forefeel.devices.ascii_line.protocol import COUNTS_RANGE, NEWTON_PER_UNIT, encode_line
from forefeel.devices.ascii_line.settings import AsciiLineSettings
from forefeel.devices.emulation.bench import (
    NOISE_N,
    Emulation,
    SerialBench,
    Surroundings,
    felt,
)
from forefeel.devices.emulation.sensing import FAULTS, EmulatedSensor, Sensing

# Hz, conversions of the emulated cells where no other rate is asked for; 80 is the faster of the two output
# rates in the HX711's data sheet
LOADSTAR_RATE_HZ, HX711_RATE_HZ = 150.0, 80.0
_LONGEST_COMMAND_BYTES = 64  # bytes of a command that are kept


class EmulatedLoadstar:
    """A Loadstar cell. `O0W1` and `W` ask for one reading in millipound-force, `O0W0` for a stream of
    them; `SS1` and `SLC` for its number and its capacity in pounds; `CT0` tares. A carriage return ends every
    command, and alone a stream; it is answered with `A`.
    """

    faults = FAULTS

    def __init__(
        self, feel: Callable[[float], float], sensing: Sensing | None = None, number: str = "001"
    ) -> None:
        self.sensing = sensing or Sensing(LOADSTAR_RATE_HZ, resolution_n=NEWTON_PER_UNIT["millipound_force"])
        self._sensor = EmulatedSensor(self.sensing, feel)
        self._number, self._tare_n = number, 0.0
        self._line, self._out = bytearray(), bytearray()
        self._streaming = False
        self._conversions, self._force_n = 0, 0.0

    def receive(self, data: bytes, t_s: float) -> None:
        self._convert(t_s)
        for byte in data:
            if byte == 0x0D:
                self._obey(self._line.decode("ascii", "replace").strip())
                self._line.clear()
            elif len(self._line) < _LONGEST_COMMAND_BYTES:
                self._line.append(byte)

    def advance(self, t_s: float) -> bytes:
        self._convert(t_s)
        out, self._out = bytes(self._out), bytearray()
        return out

    def provoke(self, fault: str) -> None:
        """Begins `stuck` or `overrange`; `free` ends both."""
        self._sensor.provoke(fault)

    def _convert(self, t_s: float) -> None:
        while (made_s := (self._conversions + 1) / self.sensing.rate_hz) <= t_s:
            self._force_n = self._sensor.measure(made_s)
            self._conversions += 1
            if self._streaming:
                self._out += self._weight()

    def _weight(self) -> bytes:
        newton = NEWTON_PER_UNIT["millipound_force"]
        return encode_line((self._force_n - self._tare_n) / newton, "millipound_force")

    def _obey(self, command: str) -> None:
        self._streaming = command == "O0W0"
        if command in ("O0W1", "W"):
            self._out += self._weight()
        elif command == "SS1":
            self._out += f"{self._number}\r\n".encode()
        elif command == "SLC":
            pounds = self.sensing.full_scale_n / NEWTON_PER_UNIT["millipound_force"] / 1000.0
            self._out += b"%.2f\r\n" % pounds
        elif command == "CT0":
            self._tare_n = self._force_n
            self._out += b"A\r\n"
        elif not command:
            self._out += b"A\r\n"


class EmulatedHx711:
    """An HX711 behind a microcontroller, which prints counts of 24 bit by itself, each after `label`."""

    faults = FAULTS

    def __init__(
        self,
        feel: Callable[[float], float],
        sensing: Sensing | None = None,
        counts_per_n: float = 200_000.0,
        zero_counts: int = 84_000,
        label: str = "",
    ) -> None:
        self.sensing = sensing or Sensing(HX711_RATE_HZ)
        self._sensor = EmulatedSensor(self.sensing, feel)
        self._counts_per_n, self._zero_counts = counts_per_n, zero_counts
        self._label = label.encode("ascii")
        self.sent = 0

    def receive(self, data: bytes, t_s: float) -> None:
        """Ignores the bytes: the sketch does not listen."""

    def advance(self, t_s: float) -> bytes:
        found = b""
        while (made_s := (self.sent + 1) / self.sensing.rate_hz) <= t_s:
            found += self._label + encode_line(self._counts(self._sensor.measure(made_s)), "counts")
            self.sent += 1
        return found

    def provoke(self, fault: str) -> None:
        """Begins `stuck` or `overrange`; `free` ends both."""
        self._sensor.provoke(fault)

    def _counts(self, force_n: float) -> int:
        low, high = COUNTS_RANGE
        if self._sensor.saturated:
            return high if force_n > 0.0 else low
        return min(max(round(self._zero_counts + self._counts_per_n * force_n), low), high)


def build(settings: AsciiLineSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """Builds an HX711 where the unit is counts, else a Loadstar cell, for `Emulation`."""
    sensing = Sensing(settings.rate_hz, full_scale_n=settings.full_scale_n, noise_n=NOISE_N, seed=around.seed)
    feel = felt(around, settings.sign, leave)
    device = EmulatedHx711(feel, sensing) if settings.unit == "counts" else EmulatedLoadstar(feel, sensing)
    return SerialBench(device, Path(settings.port), settings.baud)


EMULATION = Emulation({"full_scale_n": 10.0, "unit": "millipound_force", "request": "O0W1"}, build)
