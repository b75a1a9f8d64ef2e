"""A handle with a voice coil and an encoder, its microcontroller's firmware, and the person who holds it."""

from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from math import floor, inf
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.common.messages import Grip
from forefeel.devices.coil.protocol import (
    NAME,
    PROTOCOL,
    Button,
    CoilCommand,
    CoilIdentity,
    CoilParser,
    CoilState,
    Flag,
    Identify,
    encode,
)
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.emulation.bench import (
    Emulation,
    SerialBench,
    Surroundings,
)
from forefeel.devices.shared.settings import Sign
from forefeel.devices.simulated.operator import Operator
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.master.handle import Handle, HandleReading, Indication

_PERIOD_S = 0.001  # s between two states: the protocol's 1 kHz
_COOL = 0.7  # of the heat that trips: where the coil counts as cool again
_LOST_S = 1.0  # how long the encoder looks for its zero
_HANG_S = 0.5  # after which the hardware's own watchdog starts the firmware anew
_DARK = Indication(None, None)
_NO_COMMAND = CoilCommand(0, 0, None, None, False)


@dataclass(frozen=True, slots=True)
class CoilHardware:
    """What the device is made of. `continuous_a`: what the coil bears for ever, its heat after I^2 t with
    `thermal_s`; `peak_a`: what the amplifier gives at most; `sign`: -1 where it counts against the insertion.
    """

    counts_per_m: float = 1e6
    newton_per_ampere: float = 2.0
    sign: Sign = 1
    peak_a: float = 3.0
    continuous_a: float = 2.0
    thermal_s: float = 20.0
    longest_watchdog_ms: int = 100
    protocol: int = PROTOCOL
    name: str = NAME
    serial: str = "emulated"
    firmware: str = "1.0"


class QuadratureEncoder:
    """Counts, and their rate from the times of the edges, between which the motion is a straight line."""

    def __init__(self, counts_per_m: float) -> None:
        self._per_m = counts_per_m
        self._exact: float | None = None
        self._t_s = 0.0
        self._edge, self._edge_s = 0, -inf
        self._rate = 0.0
        self.counts = 0

    @property
    def velocity(self) -> int:
        """Counts per s: of the last two edges, and less when the next one should have come by now."""
        waited_s = self._t_s - self._edge_s
        bound = inf if waited_s <= 0.0 else 1.0 / waited_s
        return round(max(-bound, min(bound, self._rate)))

    def move(self, position_m: float, t_s: float) -> None:
        """Sets where the hand is at that time."""
        exact = position_m * self._per_m
        before, was_s = self._exact, self._t_s
        self._exact, self._t_s = exact, t_s
        now = floor(exact)
        if before is None or now == self.counts or t_s <= was_s:
            self.counts = now
            return
        edge = now if exact > before else now + 1
        edge_s = was_s + (edge - before) / (exact - before) * (t_s - was_s)
        self._rate = (edge - self._edge) / (edge_s - self._edge_s) if edge_s > self._edge_s else 0.0
        self._edge, self._edge_s, self.counts = edge, edge_s, now


class CoilDevice:
    """The firmware at 1 kHz, pure in time: an `EmulatedDevice`.

    `person` holds the handle: feels the coil's force, sees the lamp and the stage's position that the host
    sends (dark when the host is silent); the synthetic operator without one.

    Attributes:
        counters: what came over the wire and was dropped, and frames, commands, trips.
        current_a: in the coil now.
    """

    faults = "stuck", "overrange", "drive_fault"

    def __init__(
        self, hardware: CoilHardware | None = None, person: Handle | None = None, seed: int = 0
    ) -> None:
        self.hardware = hardware or CoilHardware()
        self.counters: Counter[str] = Counter()
        self.current_a = 0.0
        self.person = person if person is not None else _operator(seed)
        self._parser, self._encoder = CoilParser(self.counters), QuadratureEncoder(self.hardware.counts_per_m)
        self._watchdog_s, self._limit_a = 0.0, 0.0
        self._heat, self._next = 0.0, 0
        self._found_s, self._hangs_until_s = -inf, -inf
        self._start(0.0)

    def _start(self, t_s: float) -> None:
        """Power comes on, or the firmware starts anew."""
        self._started_s, self._sequence = t_s, 0
        self._identified, self._flags = False, Flag(0)
        self._command, self._command_s = _NO_COMMAND, -inf
        self._answer = self._sent = b""

    def receive(self, data: bytes, t_s: float) -> None:
        if t_s < self._hangs_until_s:
            return
        for frame in self._parser.feed(data):
            if isinstance(frame, Identify):
                self._identify(frame, t_s)
            elif isinstance(frame, CoilCommand):
                self.counters["commands"] += 1
                if self._command is not _NO_COMMAND:
                    self.counters["commands_lost"] += (frame.sequence - self._command.sequence - 1) % 2**16
                self._command, self._command_s = frame, t_s

    def advance(self, t_s: float) -> bytes:
        sent, self._answer = bytearray(self._answer), b""
        while self._next * _PERIOD_S <= t_s + 1e-9:
            sent += self._step(self._next * _PERIOD_S)
            self._next += 1
        return bytes(sent)

    def provoke(self, fault: str) -> None:
        """`stuck`: the firmware hangs for half a second, repeating its last frame, and starts anew;
        `overrange`: the encoder loses its zero for a second; `drive_fault`: the amplifier trips.
        """
        match fault:
            case "stuck":
                self._hangs_until_s = self._next * _PERIOD_S + _HANG_S
            case "overrange":
                self._found_s = self._next * _PERIOD_S + _LOST_S
            case "drive_fault":
                self._flags |= Flag.OVERCURRENT
            case _:
                raise ConfigurationError(
                    f"{fault}: expected stuck, overrange or drive_fault for a coil handle"
                )

    def _identify(self, request: Identify, t_s: float) -> None:
        hardware = self.hardware
        watchdog_ms = min(request.watchdog_ms, hardware.longest_watchdog_ms)
        limit_ma = min(request.limit_ma, round(hardware.peak_a * 1e3))
        self._watchdog_s, self._limit_a = watchdog_ms * 1e-3, limit_ma * 1e-3
        self._flags &= ~(Flag.WATCHDOG | Flag.OVERCURRENT)
        self._identified = True
        self._command, self._command_s = _NO_COMMAND, t_s
        texts = hardware.name, hardware.serial, hardware.firmware
        self._answer += encode(CoilIdentity(hardware.protocol, watchdog_ms, limit_ma, *texts))

    def _step(self, t_s: float) -> bytes:
        reading = self._live(t_s)
        if self._hangs_until_s > -inf:
            if t_s < self._hangs_until_s:
                return self._sent
            self._hangs_until_s = -inf
            self._start(t_s)
        if not self._identified:
            return b""
        self._sequence += 1
        self._sent = encode(
            CoilState(
                self._sequence,
                round((t_s - self._started_s) * 1e6),
                self._encoder.counts,
                self._encoder.velocity,
                _buttons(reading),
                self._flags,
                round(self.current_a * 1e3),
            )
        )
        self.counters["states"] += 1
        return self._sent

    def _live(self, t_s: float) -> HandleReading:
        """A millisecond of the person, the encoder and the coil."""
        heard = self._identified and t_s - self._command_s <= self._watchdog_s
        command = self._command
        now_ns = round(t_s * 1e9)
        where_m = None if command.stage_um is None else command.stage_um * 1e-6
        self.person.show(Indication(command.lamp, where_m) if heard else _DARK)
        self._protect(t_s, heard)
        hardware = self.hardware
        self.person.render(hardware.sign * self.current_a * hardware.newton_per_ampere, now_ns)
        reading = self.person.read(now_ns)
        self._encoder.move(hardware.sign * reading.position_m, t_s)
        return reading

    def _protect(self, t_s: float, heard: bool) -> None:
        """Sets the flags and the current that the firmware permits.

        WATCHDOG and OVERCURRENT stay until `Identify`, OVER_TEMPERATURE until the coil has cooled, NOT_HOMED
        until the zero is found.
        """
        hardware = self.hardware
        share = _PERIOD_S / hardware.thermal_s
        self._heat += share * (self.current_a**2 - self._heat)
        trips = hardware.continuous_a**2
        if self._heat > trips:
            self._flags |= Flag.OVER_TEMPERATURE
        elif self._heat < _COOL * trips:
            self._flags &= ~Flag.OVER_TEMPERATURE
        self._flags = self._flags & ~Flag.NOT_HOMED | (Flag.NOT_HOMED if t_s < self._found_s else Flag(0))
        if self._identified and not heard and Flag.WATCHDOG not in self._flags:
            self._flags |= Flag.WATCHDOG
            self.counters["watchdog_trips"] += 1
        allowed = self._command.enabled and not self._flags
        wanted_a = self._command.current_ma * 1e-3 if allowed else 0.0
        self.current_a = max(-self._limit_a, min(self._limit_a, wanted_a))


def _operator(seed: int) -> Operator:
    return Operator(OperatorSettings(), seed)


def _buttons(reading: HandleReading) -> Button:
    pressed = Button.DEADMAN if reading.deadman else Button(0)
    return pressed | (Button.GRIPPER if reading.gripper is Grip.OPEN else Button(0))


def build(settings: CoilSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """Builds the handle, in the hand of the synthetic operator, for `Emulation`."""
    del leave
    hardware = CoilHardware(
        counts_per_m=settings.counts_per_m,
        newton_per_ampere=settings.newton_per_ampere,
        sign=settings.sign,
        peak_a=settings.max_current_a,
    )
    return SerialBench(CoilDevice(hardware, seed=around.seed), Path(settings.port), settings.baud)


EMULATION = Emulation({"counts_per_m": 1e6, "newton_per_ampere": 2.0, "max_current_a": 3.0}, build)
