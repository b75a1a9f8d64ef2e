"""A handle with a voice coil and an encoder, its microcontroller's firmware, and the person who holds it."""

from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from math import floor, inf
from pathlib import Path

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
from forefeel.devices.emulation.bench import Emulation, SerialBench, Surroundings
from forefeel.devices.shared.settings import Sign
from forefeel.devices.simulated.operator import Operator
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.master.handle import Handle, HandleReading, Indication

_PASSING = {"overrange": Flag.NOT_HOMED, "hot": Flag.OVER_TEMPERATURE}
_PASSES_S = 1.0  # s that the encoder looks for its zero, or the coil cools
_HANG_S = 0.5  # s after which the hardware's own watchdog starts the firmware anew
_DARK = Indication(None, None)
_NO_COMMAND = CoilCommand(0, 0, None, None, False)


@dataclass(frozen=True, slots=True)
class CoilHardware:
    """Constants of the emulated hardware. `peak_a`: the amplifier's limit; `sign`: -1 where it counts against
    the insertion; `knows_counts`: whether it says what a metre counts.
    """

    period_us: int = 1000
    counts_per_m: float = 1e6
    knows_counts: bool = True
    newton_per_ampere: float = 2.0
    sign: Sign = 1
    peak_a: float = 3.0
    longest_watchdog_ms: int = 100
    protocol: int = PROTOCOL
    name: str = NAME
    serial: str = "emulated"


class CoilDevice:
    """The firmware, pure in time: an `EmulatedDevice`.

    `person` holds the handle: feels the coil's force, sees the lamp and the stage's position that the host
    sends (dark when the host is silent); the synthetic operator without one.

    Attributes:
        counters: what came over the wire and was dropped, and frames, commands, trips.
        current_a: in the coil now.
    """

    faults = "stuck", "drive_fault", *_PASSING

    def __init__(
        self, hardware: CoilHardware | None = None, person: Handle | None = None, seed: int = 0
    ) -> None:
        self.hardware = hardware or CoilHardware()
        self._period_s = self.hardware.period_us * 1e-6
        self.counters: Counter[str] = Counter()
        self.current_a = 0.0
        self.person = person or Operator(OperatorSettings(), seed)
        self._parser = CoilParser(self.counters)
        self._watchdog_s, self._limit_a = 0.0, 0.0
        self._next = 0
        self._passing, self._passes_s, self._hangs_until_s = Flag(0), -inf, -inf
        self._start(0.0)

    def _start(self, t_s: float) -> None:
        """Starts the firmware, at power or anew."""
        self._started_s, self._sequence = t_s, 0
        self._identified, self._flags = False, Flag(0)
        self._command, self._command_s = _NO_COMMAND, -inf
        self._answer = self._sent = b""

    def receive(self, data: bytes, t_s: float) -> None:
        """Answers requests of the identity, stores the newest command; neither while the firmware hangs."""
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
        while self._next * self._period_s <= t_s + 1e-9:
            sent += self._step(self._next * self._period_s)
            self._next += 1
        return bytes(sent)

    def provoke(self, fault: str) -> None:
        """Begins a fault: `stuck`: the firmware hangs for 0.5 s, repeating its last frame, and restarts;
        `drive_fault`: the amplifier trips; for a second `overrange`: the encoder loses its zero, `hot`: the
        coil is too hot.
        """
        match fault:
            case "stuck":
                self._hangs_until_s = self._next * self._period_s + _HANG_S
            case "drive_fault":
                self._flags |= Flag.OVERCURRENT
            case _:
                self._passing, self._passes_s = _PASSING[fault], self._next * self._period_s + _PASSES_S

    def _identify(self, request: Identify, t_s: float) -> None:
        """Answers a request with the identity, sets watchdog and current limit (at most its own), clears
        flags. Only WATCHDOG and OVERCURRENT are cleared; the command is forgotten, and the watchdog runs from
        now.
        """
        hardware = self.hardware
        watchdog_ms = min(request.watchdog_ms, hardware.longest_watchdog_ms)
        limit_ma = min(request.limit_ma, round(hardware.peak_a * 1e3))
        self._watchdog_s, self._limit_a = watchdog_ms * 1e-3, limit_ma * 1e-3
        self._flags &= ~(Flag.WATCHDOG | Flag.OVERCURRENT)
        self._identified = True
        self._command, self._command_s = _NO_COMMAND, t_s
        period_us, counts = hardware.period_us, round(hardware.counts_per_m) if hardware.knows_counts else 0
        limits = watchdog_ms, limit_ma
        measures = period_us, period_us, counts  # a command waits for the next step
        identity = hardware.name, hardware.serial, "2.0"
        self._answer += encode(CoilIdentity(hardware.protocol, *limits, *measures, *identity))

    def _step(self, t_s: float) -> bytes:
        """Advances by one period and returns the state as bytes: none before the request, the last while it
        hangs. When it no longer hangs, the firmware restarts.
        """
        reading = self._live(t_s)
        if self._hangs_until_s > -inf:
            if t_s < self._hangs_until_s:
                return self._sent
            self._hangs_until_s = -inf
            self._start(t_s)
        if not self._identified:
            return b""
        self._sequence += 1
        counts_per_m = self.hardware.sign * self.hardware.counts_per_m
        pressed = Button.DEADMAN if reading.deadman else Button(0)
        pressed |= Button.GRIPPER if reading.gripper is Grip.OPEN else Button(0)
        self._sent = encode(
            CoilState(
                self._sequence,
                round((t_s - self._started_s) * 1e6),
                floor(reading.position_m * counts_per_m),
                round(reading.velocity_m_s * counts_per_m),
                pressed,
                self._raised(t_s),
                round(self.current_a * 1e3),
            )
        )
        return self._sent

    def _live(self, t_s: float) -> HandleReading:
        """Sets the current, lets the person feel it and see the lamp, and returns the person's reading. The
        lamp is dark when the host is silent.
        """
        in_time = self._identified and t_s - self._command_s <= self._watchdog_s
        command = self._command
        now_ns = round(t_s * 1e9)
        where_m = None if command.stage_um is None else command.stage_um * 1e-6
        self.person.show(Indication(command.lamp, where_m) if in_time else _DARK)
        self._protect(t_s, in_time)
        hardware = self.hardware
        self.person.render(hardware.sign * self.current_a * hardware.newton_per_ampere, now_ns)
        return self.person.read(now_ns)

    def _raised(self, t_s: float) -> Flag:
        return self._flags | (self._passing if t_s < self._passes_s else Flag(0))

    def _protect(self, t_s: float, in_time: bool) -> None:
        """Sets `current_a` to the commanded current within the limit, or to 0 while disabled or with a fault.
        `in_time` False, once identified, sets WATCHDOG, which stays until `Identify`.
        """
        if self._identified and not in_time and Flag.WATCHDOG not in self._flags:
            self._flags |= Flag.WATCHDOG
            self.counters["watchdog_trips"] += 1
        allowed = self._command.enabled and not self._raised(t_s)
        wanted_a = self._command.current_ma * 1e-3 if allowed else 0.0
        self.current_a = max(-self._limit_a, min(self._limit_a, wanted_a))


def build(settings: CoilSettings, around: Surroundings, leave: ExitStack) -> SerialBench:
    """Builds the emulated handle on the settings' port, for `Emulation`; a synthetic operator holds it."""
    del leave
    hardware = CoilHardware(
        counts_per_m=settings.counts_per_m or 1e6,
        knows_counts=settings.counts_per_m is None,
        newton_per_ampere=settings.newton_per_ampere,
        sign=settings.sign,
        peak_a=settings.max_current_a,
    )
    return SerialBench(CoilDevice(hardware, seed=around.seed), Path(settings.port), settings.baud)


EMULATION = Emulation({"newton_per_ampere": 2.0, "max_current_a": 3.0}, build)
