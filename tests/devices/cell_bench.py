"""A serial load cell, its driver and an adapter that may collect bytes, in stepped time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from random import Random
from typing import TypeVar

from forefeel.devices.ascii_line.driver import AsciiLineLoadCell
from forefeel.devices.bota.driver import BotaSerialLoadCell
from forefeel.devices.emulation.wire import EmulatedDevice
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from forefeel.testing import SerialLine, SteppedTime, stepped
from tests.emulators.damage import DamagedWire, Faults

NAME = "/dev/serial/by-id/cell"
NOW_S = 1.0  # the host's clock when the device is switched on
STEP_NS = 500_000
D = TypeVar("D", BotaSerialLoadCell, AsciiLineLoadCell)


class UsbLine(SerialLine):
    """The adapter collects bytes for `hub_s`, and delivers them up to as much later."""

    def __init__(
        self, time: SteppedTime, device: EmulatedDevice, baud: int, faults: Faults | None, hub_s: float
    ) -> None:
        self._every, self._random = round(hub_s * 1e9 / STEP_NS), Random(3)
        self._ticks, self._due = 0, 0
        self._coming, self._collected = b"", b""
        super().__init__(time, device, baud, NAME)
        self.to_host = self.damaged = DamagedWire(baud, faults or Faults(), "out 1")

    def live(self, t_s: float) -> None:
        super().live(t_s)
        self._ticks += 1
        if self._every:
            self._coming += self.to_host.arrived(t_s)
            if self._ticks % self._every == 0:
                self._due = self._ticks + self._random.randint(0, self._every)
                self._collected, self._coming = self._collected + self._coming, b""

    def arrived(self, t_s: float) -> bytes:
        if not self._every:
            return super().arrived(t_s)
        if self._ticks < self._due:
            return b""
        found, self._collected = self._collected, b""
        return found


class Port:
    """A device behind an adapter; `time` and `line` are there while a driver is open."""

    time: SteppedTime
    line: "UsbLine"

    def __init__(
        self, device: EmulatedDevice, baud: int, faults: Faults | None = None, hub_s: float = 0.0
    ) -> None:
        self.device, self._arguments = device, (baud, faults, hub_s)

    @contextmanager
    def made(self, make: Callable[[SteppedTime], D]) -> Iterator[D]:
        """The driver, not opened; closed at the end."""
        with stepped(STEP_NS) as self.time:
            self.line = UsbLine(self.time, self.device, *self._arguments)
            driver = make(self.time)
            try:
                yield driver
            finally:
                driver.close()

    @contextmanager
    def opened(self, make: Callable[[SteppedTime], D]) -> Iterator[D]:
        with self.made(make) as driver:
            driver.open()
            yield driver

    def played(self, driver: LoadCell, seconds: float) -> list[LoadCellReading]:
        """The readings of that time from now."""
        driver.read(self.time.now_ns(), None)
        self.time.run(seconds)
        return list(driver.read(self.time.now_ns(), None))


def stamp_s(reading: LoadCellReading) -> float:
    """When it was made, since the device was switched on."""
    assert reading.stamp_ns is not None
    return reading.stamp_ns * 1e-9 - NOW_S
