"""A driver and an emulated device in one process, in virtual time, in step with the test."""

import time
from collections import deque
from collections.abc import Callable
from random import Random
from threading import Condition

from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.devices.emulation.device import EmulatedDevice
from forefeel.devices.emulation.wire import Faults, Wire
from forefeel.devices.shared.settings import SerialSettings

NOW_S = 1000.0  # the host's clock when the device is switched on


class Port:
    """A serial port whose time goes on only as far as the test lets it, and only while the driver reads.

    `hub_s`: the adapter collects for that long, as USB does; `late_s`: it delivers up to so much later.
    """

    def __init__(
        self,
        device: EmulatedDevice,
        baud: int,
        faults: Faults | None = None,
        hub_s: float = 0.0,
        late_s: float = 0.0,
        step_s: float = 0.0005,
        until_s: float = 2.0,
    ) -> None:
        self.clock = VirtualClock(round(NOW_S * 1e9))
        self.device, self.plugged, self.silent = device, True, False
        self.opened = 0
        self.to_device = Wire(baud, Faults(), "in")
        self.to_host = Wire(baud, faults or Faults(), "out 1")
        self._hub_s, self._step_s = hub_s, step_s
        self._ticks, self._until = 0, round(until_s / step_s)
        self._late = round(late_s / step_s)
        self._random, self._due = Random(7), 0
        self._delivered, self._collected = deque[bytes](), deque[bytes]()
        self._changed, self._idle = Condition(), False

    @property
    def t_s(self) -> float:
        """Since the device was switched on."""
        return self._ticks * self._step_s

    def open(self, settings: SerialSettings, timeout_s: float) -> "Port":
        """To be given to the driver."""
        if not self.plugged:
            raise DeviceError(f"{settings.port}: no such port")
        self.opened += 1
        self._delivered.clear()
        return self

    def play(self, seconds: float) -> None:
        """Lets the driver live that much longer."""
        with self._changed:
            self._until, self._idle = self._ticks + round(seconds / self._step_s), False
            self._changed.notify_all()
        self.settle()

    def settle(self) -> None:
        """Until the driver has done all that it may."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._idle, 30.0)

    def play_until(self, true: Callable[[], bool]) -> None:
        """Lets the driver live until something is true."""
        end_s = time.monotonic() + 20.0
        while not true():
            assert time.monotonic() < end_s
            with self._changed:
                self._until = self._ticks + 20
                self._changed.notify_all()
            time.sleep(0.001)

    def read(self) -> bytes:
        with self._changed:
            if self._ticks >= self._until:
                self._idle = True  # all that it got before is done
                self._changed.notify_all()
                if not self._changed.wait_for(lambda: self._ticks < self._until, 0.01):
                    return b""  # no time passes
            if not self.plugged:
                raise DeviceError("gone while reading")
            self._ticks += 1
            self.clock.set_ns(round((NOW_S + self.t_s) * 1e9))
            return self._live()

    def _live(self) -> bytes:
        at_s = self.t_s
        heard = self.to_device.arrived(at_s)
        if heard:
            self.device.receive(heard, at_s)
        sent = self.device.advance(at_s)
        self.to_host.send(b"" if self.silent else sent, at_s)
        if (arrived := self.to_host.arrived(at_s)) != b"":
            self._delivered.append(arrived)
        every = round(self._hub_s / self._step_s)
        if every and self._ticks % every == 0:
            self._due = self._ticks + self._random.randint(0, self._late)
            self._collected, self._delivered = self._collected + self._delivered, deque()
        if every:
            if self._ticks < self._due:
                return b""
            found, self._collected = b"".join(self._collected), deque()
            return found
        found = b"".join(self._delivered)
        self._delivered.clear()
        return found

    def write(self, data: bytes) -> None:
        self.to_device.send(data, self.t_s)

    def close(self) -> None:
        """Nothing to let go."""
