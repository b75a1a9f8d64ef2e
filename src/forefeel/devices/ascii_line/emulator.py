"""An emulated load cell that prints numbers, as Loadstar's and an HX711 behind a microcontroller do. Pure."""

from contextlib import ExitStack
from pathlib import Path

from forefeel.devices.ascii_line.protocol import COUNTS_RANGE, NEWTON_PER_UNIT, Unit, encode_line
from forefeel.devices.ascii_line.settings import AsciiLineSettings
from forefeel.devices.emulation.bench import Emulation, SerialBench, Surroundings, sensor_of
from forefeel.devices.emulation.sensing import FAULTS, EmulatedSensor

_COUNTS_PER_N, _ZERO_COUNTS = 200_000.0, 84_000
_LONGEST_COMMAND_BYTES = 64  # bytes of a command that are kept


class EmulatedLineCell:
    """Prints by itself where it has no `request`. Else that asks for one reading, and a carriage return that
    ends no command is answered with `A`.
    """

    faults = FAULTS

    def __init__(self, sensor: EmulatedSensor, unit: Unit, request: str | None = None) -> None:
        self._sensor, self._unit, self._request = sensor, unit, request
        self._command, self._out = bytearray(), bytearray()
        self._force_n = 0.0

    def receive(self, data: bytes, t_s: float) -> None:
        """Advances the cell to `t_s`, then obeys each command that a carriage return ends; the answers wait
        for `advance`.
        """
        self._live(t_s)
        for byte in data:
            if byte == 0x0D:
                self._obey(self._command.decode("ascii", "replace").strip())
                self._command.clear()
            elif len(self._command) < _LONGEST_COMMAND_BYTES:
                self._command.append(byte)

    def advance(self, t_s: float) -> bytes:
        self._live(t_s)
        out, self._out = bytes(self._out), bytearray()
        return out

    def provoke(self, fault: str) -> None:
        self._sensor.provoke(fault)

    def _live(self, t_s: float) -> None:
        for _, force_n in self._sensor.due(t_s):
            self._force_n = force_n
            if self._request is None:
                self._out += self._line()

    def _obey(self, command: str) -> None:
        """Answers the request with the newest force, an empty command with `A`; ignores other commands, and
        all where the cell streams.
        """
        if self._request is None:
            return
        if not command:
            self._out += b"A\r\n"
        elif command == self._request:
            self._out += self._line()

    def _line(self) -> bytes:
        """Returns the newest force as a line in the cell's unit; an end of the range for saturated counts."""
        if self._unit != "counts":
            return encode_line(self._force_n / NEWTON_PER_UNIT[self._unit], self._unit)
        low, high = COUNTS_RANGE
        counts = _ZERO_COUNTS + _COUNTS_PER_N * self._force_n
        if self._sensor.saturated:
            counts = high if self._force_n > 0.0 else low
        return encode_line(min(max(counts, low), high), "counts")


def build(settings: AsciiLineSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    device = EmulatedLineCell(sensor_of(settings, around, leave), settings.unit, settings.request)
    return SerialBench(device, Path(settings.port), settings.baud)


EMULATION = Emulation({"full_scale_n": 10.0, "unit": "millipound_force", "request": "O0W1"}, build)
