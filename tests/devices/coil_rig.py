"""A coil handle in stepped time: the emulated device on a wire in memory, its driver without a thread."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.common.messages import Grip, SafetyState
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.simulated.operator import SimulatedHandle
from forefeel.master.handle import HandleReading, Indication
from forefeel.testing import SerialLine, SteppedTime, stepped
from tests.emulators.damage import Faults, damaged


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
        velocity_m_s = 0.0
        if self.course is not None:
            self.position_m = self.course(now_ns * 1e-9)
            velocity_m_s = (self.position_m - self.course(now_ns * 1e-9 - 1e-4)) * 1e4
        return HandleReading(self.position_m, velocity_m_s, self.pressed, self.grip)


class Bench:
    """A handle that a test's hand holds; the haptic loop reads and renders `force_n` each ms.

    Attributes:
        silent: whether the driver's thread hangs; `haptic`: whether the haptic loop ticks.
    """

    def __init__(
        self,
        time: SteppedTime,
        faults: Faults | None = None,
        hardware: CoilHardware | None = None,
        **changes: Any,  # noqa: ANN401 - any field of the settings
    ) -> None:
        self.time = time
        self.hand = Hand()
        self.device = CoilDevice(hardware, self.hand)
        self.line = SerialLine(time, self.device, 2_000_000)
        self.wires = self.line.to_device, self.line.to_host = damaged(2_000_000, faults)
        self.handle = CoilHandle(coil_settings(**changes), time)
        self.force_n = 0.0
        self.readings = list[HandleReading | None]()
        self.currents_a = list[float]()
        self.applied_n = 0.0
        self.haptic, self.silent = True, False

    @property
    def reading(self) -> HandleReading:
        found = self.readings[-1]
        assert found is not None
        return found

    @property
    def counters(self) -> dict[str, int]:
        return dict(self.handle.counters)

    def run(self, duration_ms: int) -> "Bench":
        self.time.tick = self._tick
        (self.time.host_hangs if self.silent else self.time.run)(duration_ms * 1e-3)
        self.time.tick = lambda now_ns: None
        return self

    def _tick(self, now_ns: int) -> None:
        if self.haptic:
            self.handle.show(Indication(SafetyState.ARMED, 0.0123))
            try:
                self.readings.append(self.handle.read(now_ns))
                self.applied_n = self.handle.render(self.force_n, now_ns)
            except DeviceError:
                self.readings.append(None)
                self.applied_n = 0.0
        self.currents_a.append(self.device.current_a)

    def press(self, pressed: bool) -> "Bench":
        self.hand.pressed = pressed
        return self.run(10)

    @property
    def state(self) -> LinkState:
        return self.handle.link.state

    def fallen(self) -> str:
        """Why the link is down; nothing is read, nothing rendered."""
        assert self.readings[-1] is None
        why = self.handle.link.inhibited
        assert why is not None
        with pytest.raises(DeviceError, match=r"memory: .+"):
            self.handle.render(1.0, self.time.now_ns())
        return why


@contextmanager
def closed(**arguments: Any) -> Iterator[Bench]:  # noqa: ANN401 - of a bench
    with stepped() as time:
        bench = Bench(time, **arguments)
        try:
            yield bench
        finally:
            bench.handle.close()


@contextmanager
def opened(**arguments: Any) -> Iterator[Bench]:  # noqa: ANN401 - of a bench
    with closed(**arguments) as bench:
        bench.handle.open()
        yield bench.run(20)
