"""A CiA 404 force transducer on any python-can bus."""

import time
from collections.abc import Callable
from contextlib import ExitStack

import can

from forefeel.devices.canopen.bus import open_until
from forefeel.devices.canopen.emulator import CanopenDevice, common_contents
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.devices.emulation.bench import Emulation, Surroundings, sensor_of
from forefeel.devices.emulation.sensing import FAULTS, EmulatedSensor

SERIAL = 0x0404_0001  # serial number of the emulated transducer, object 1018:04; made up


class Transducer404(CanopenDevice):
    """The transducer: run `step` over and over in one thread.

    Args:
        bus: an open bus of its own.
        node: its identifier.
        sensor: measures at each SYNC, in the unit.
        unit: of its object 6131.
        now_s: a clock.
    """

    faults = "unplug", "plug", *FAULTS

    def __init__(
        self,
        bus: can.BusABC,
        node: int,
        sensor: EmulatedSensor,
        unit: int = cia404.NEWTON,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._sensor, self._value = sensor, 0.0
        objects = {cia404.PROCESS_VALUE: 0.0, cia404.UNIT: unit, cia404.STATUS: 0}
        super().__init__(bus, node, {**common_contents(node, cia404.PROFILE, SERIAL), **objects}, now_s)

    def provoke(self, fault: str) -> None:
        """`stuck`: the value stays and counts as valid; `overrange`; `free` ends both; `unplug`, `plug`."""
        if fault in FAULTS:
            self._sensor.provoke(fault)
        else:
            super().provoke(fault)

    def shown(self, index: int, sub: int) -> float | None:
        """Returns the process value, or the status: 0, or not valid and over or under while saturated. None
        for any other object.
        """
        del sub
        if index == cia404.PROCESS_VALUE.index:
            return self._value
        if index != cia404.STATUS.index:
            return None
        overload = cia404.OVER if self._value > 0 else cia404.UNDER
        return cia404.NOT_VALID | overload if self._sensor.saturated else 0

    def synchronised(self, t_s: float) -> None:
        self._value = self._sensor.measure(t_s)


def build(settings: Cia404Settings, around: Surroundings, leave: ExitStack) -> Transducer404:
    sensor = sensor_of(settings, around, leave)
    bus = open_until(leave, settings.can)
    return Transducer404(bus, settings.node_id, sensor, now_s=around.now_s)


EMULATION = Emulation({"node_id": 2, "full_scale_n": 10.0}, build, on_can=True)
