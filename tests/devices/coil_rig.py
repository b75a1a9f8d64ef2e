"""A coil handle in virtual time: the emulated device on a wire in memory, its driver without a thread."""

from collections.abc import Callable
from typing import Any

import pytest

from forefeel.common.clock import Clock, VirtualClock
from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.common.messages import Grip, SafetyState
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.emulation.wire import Faults, Wire
from forefeel.devices.shared.stream import ByteStream
from forefeel.devices.simulated.operator import SimulatedHandle
from forefeel.master.handle import HandleReading, Indication

MS = 1_000_000
RETRY_NS = 500 * MS


def coil_settings(**changes: Any) -> CoilSettings:  # noqa: ANN401 - any field
    fields: dict[str, Any] = {
        "driver": "coil_serial",
        "port": "memory",
        "counts_per_m": 1e6,
        "newton_per_ampere": 2.0,
        "max_current_a": 2.0,
        **changes,
    }
    return CoilSettings(**fields)


class Hand(SimulatedHandle):
    """A person whom the test moves."""

    def __init__(self) -> None:
        super().__init__()
        self.position_m, self.pressed, self.grip = 0.0, False, Grip.CLOSED
        self.course: Callable[[float], float] | None = None
        self.felt_n = 0.0

    @property
    def sees(self) -> Indication:
        return self._indication

    def render(self, force_n: float, now_ns: int) -> float:
        del now_ns
        self.felt_n = force_n
        return force_n

    def read(self, now_ns: int) -> HandleReading:
        if self.course is not None:
            self.position_m = self.course(now_ns * 1e-9)
        return HandleReading(self.position_m, 0.0, self.pressed, self.grip)


class Line:
    """A stream between a device and a host whose clock stands between two steps. The device's time runs
    `ahead_s`: what passed while the host's clock stood still at the handshake.
    """

    def __init__(self, device: CoilDevice, clock: Clock, faults: Faults | None = None) -> None:
        self.device, self.plugged, self.ahead_s = device, True, 0.0
        self.faults = faults or Faults()
        self._clock = clock
        self.to_device, self.to_host = (Wire(2_000_000, self.faults, way) for way in ("in", "out"))

    def open(self) -> "Line":
        if not self.plugged:
            raise DeviceSetupError("memory: no such port")
        return self

    def read(self) -> bytes:
        self._require_plugged()
        t_s = self._clock.now_ns() * 1e-9 + self.ahead_s
        self.live(t_s)
        return self.to_host.arrived(t_s)

    def live(self, t_s: float) -> None:
        """The device goes on, whoever listens."""
        sent = self.device.advance(t_s)
        if self.plugged:
            self.to_host.send(sent, t_s)
        arrived = self.to_device.arrived(t_s)
        if arrived:
            self.device.receive(arrived, t_s)

    def write(self, data: bytes) -> None:
        self._require_plugged()
        self.to_device.send(data, self._clock.now_ns() * 1e-9 + self.ahead_s)

    def close(self) -> None:
        pass

    def _require_plugged(self) -> None:
        if not self.plugged:
            raise DeviceError("memory: gone")


class SteppedCoil(CoilHandle):
    """The driver with `step` in the place of its thread: what Conversation does, in virtual time."""

    def __init__(self, settings: CoilSettings, clock: Clock, line: Line) -> None:
        super().__init__(settings, clock, line.open)
        self._line = line
        self._stream: ByteStream | None = None
        self._again_ns = 0
        self.silent = False

    def open(self) -> None:
        """The handshake takes 10 ms of the device's time."""
        self._line.live(self._clock.now_ns() * 1e-9)
        for _ in range(10):
            self._line.ahead_s += 0.001
            self.step(self._clock.now_ns())

    def close(self) -> None:
        self._end()

    def step(self, now_ns: int) -> None:
        """To be called each ms; `silent`: the thread hangs, and the device goes on alone."""
        if self.silent or now_ns < self._again_ns:
            self._line.live(now_ns * 1e-9 + self._line.ahead_s)
            return
        try:
            if self._stream is None:
                self._stream = self._open_stream()
                self._greet(self._stream)
            self._round(self._stream)
        except DeviceError as error:
            self.link.fault(str(error))
        if self.link.state is LinkState.CLOSED:
            self._end()
            self._again_ns = now_ns + RETRY_NS

    def _end(self) -> None:
        if self._stream is not None:
            self._part(self._stream)
            self._stream = None


class Bench:
    """A handle that a test's hand holds; the haptic loop reads and renders `force_n` each ms."""

    def __init__(
        self,
        faults: Faults | None = None,
        hardware: CoilHardware | None = None,
        **changes: Any,  # noqa: ANN401 - any field of the settings
    ) -> None:
        self.clock = VirtualClock(1000 * MS)
        self.hand = Hand()
        self.device = CoilDevice(hardware, self.hand)
        self.line = Line(self.device, self.clock, faults)
        self.handle = SteppedCoil(coil_settings(**changes), self.clock, self.line)
        self.force_n = 0.0
        self.readings = list[HandleReading | None]()
        self.currents_a = list[float]()
        self.applied_n = 0.0
        self.haptic = True

    @property
    def reading(self) -> HandleReading:
        found = self.readings[-1]
        assert found is not None
        return found

    @property
    def counters(self) -> dict[str, int]:
        return dict(self.handle.counters)

    def run(self, duration_ms: int) -> "Bench":
        for _ in range(duration_ms):
            self.clock.set_ns(self.clock.now_ns() + MS)
            self.handle.step(self.clock.now_ns())
            if self.haptic:
                self._tick(self.clock.now_ns())
            self.currents_a.append(self.device.current_a)
        return self

    def _tick(self, now_ns: int) -> None:
        self.handle.show(Indication(SafetyState.ARMED, 0.0123))
        try:
            self.readings.append(self.handle.read(now_ns))
            self.applied_n = self.handle.render(self.force_n, now_ns)
        except DeviceError:
            self.readings.append(None)
            self.applied_n = 0.0

    def press(self, pressed: bool) -> "Bench":
        self.hand.pressed = pressed
        return self.run(10)


def opened(**arguments: object) -> Bench:
    bench = Bench(**arguments)  # type: ignore[arg-type]
    bench.handle.open()
    assert state(bench) is LinkState.READY
    return bench.run(20)


def state(bench: Bench) -> LinkState:
    return bench.handle.link.state


def fallen(bench: Bench) -> str:
    """Why the link is down; nothing is read, nothing rendered."""
    assert bench.readings[-1] is None
    why = bench.handle.link.inhibited
    assert why is not None
    with pytest.raises(DeviceError, match=r"memory: .+"):
        bench.handle.render(1.0, bench.clock.now_ns())
    return why
