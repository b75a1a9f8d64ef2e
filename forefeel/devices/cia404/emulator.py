"""A CiA 404 force transducer on any python-can bus."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from math import copysign
from random import Random

import can
import canopen

from forefeel.devices.canopen.bus import open_until
from forefeel.devices.canopen.cia301 import ObjectEntry
from forefeel.devices.canopen.emulator import CanopenDevice, common_contents, unpacked
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.devices.emulation.bench import (
    NOISE_N,
    Emulation,
    Surroundings,
    felt,
)

SERIAL = 0x0404_0001  # serial number of the emulated transducer, object 1018:04; made up
# sensor type, object 6110: meant as a strain gauge, not checked against CiA 404; no driver of ours reads it
_STRAIN_GAUGE = 70
_REFUSED = 0x0800_0020  # data can not be transferred


def contents(node: int, unit: int, digits: int) -> dict[ObjectEntry, float]:
    return {
        **common_contents(node, cia404.PROFILE, SERIAL),
        cia404.SENSOR_TYPE: _STRAIN_GAUGE,
        cia404.OPERATING_MODE: 1,
        cia404.AUTOZERO: 0,
        cia404.PROCESS_VALUE: 0.0,
        cia404.UNIT: unit,
        cia404.DIGITS: digits,
        cia404.STATUS: 0,
    }


class Transducer404(CanopenDevice):
    """The transducer: run `step` over and over in one thread.

    Args:
        bus: an open bus of its own.
        node: its identifier.
        feel: the force in its unit at a time in s; converted once at each SYNC.
        full_scale: beyond it the value saturates, and its status says so.
        unit, digits: of its objects 6131 and 6132.
        now_s: a clock.
    """

    faults = "unplug", "plug", "stuck", "overrange", "free"

    def __init__(
        self,
        bus: can.BusABC,
        node: int,
        feel: Callable[[float], float],
        full_scale: float = 10.0,
        unit: int = cia404.NEWTON,
        digits: int = 2,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._feel, self._full_scale = feel, full_scale
        self._stuck = self._over = False
        self._value, self._zero, self._status = 0.0, 0.0, 0
        super().__init__(bus, node, contents(node, unit, digits), now_s)

    def provoke(self, fault: str) -> None:
        """`stuck`: the value stays and counts as valid; `overrange`; `free` ends both; `unplug`, `plug`."""
        if fault in ("stuck", "overrange", "free"):
            self._stuck, self._over = fault == "stuck", fault == "overrange"
        else:
            super().provoke(fault)

    def written(self, index: int, sub: int, value: bytes) -> None:
        """Tares on the word `zero` at 6125; any other value there is refused."""
        del sub
        if index == cia404.AUTOZERO.index:
            if unpacked(cia404.AUTOZERO, value) != cia404.ZERO:
                raise canopen.SdoAbortedError(_REFUSED)
            self._zero += self._value

    def shown(self, index: int, sub: int) -> float | None:
        del sub
        if index == cia404.PROCESS_VALUE.index:
            return self._value
        return self._status if index == cia404.STATUS.index else None

    def synchronised(self, t_s: float) -> None:
        if self._stuck:
            return
        felt = 2.0 * self._full_scale if self._over else self._feel(t_s) - self._zero
        self._value = felt if abs(felt) <= self._full_scale else copysign(self._full_scale, felt)
        overload = cia404.NOT_VALID | (cia404.OVER if felt > 0 else cia404.UNDER)
        self._status = 0 if abs(felt) <= self._full_scale else overload


def build(settings: Cia404Settings, around: Surroundings, leave: ExitStack) -> Transducer404:
    """Builds the transducer for `Emulation`. It has noise: a cell without can not be seen to stick."""
    force_n, random = felt(around, settings.sign, leave), Random(f"transducer {around.seed}")

    def noisy_n(t_s: float) -> float:
        return force_n(t_s) + random.gauss(0.0, NOISE_N)

    bus = open_until(leave, settings.can)
    return Transducer404(bus, settings.node_id, noisy_n, settings.full_scale_n, now_s=around.now_s)


EMULATION = Emulation({"node_id": 2, "full_scale_n": 10.0}, build, on_can=True)
