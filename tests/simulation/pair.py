"""Both daemons in virtual time with what a loopback run does not have: a cable to cut, hosts whose clocks
differ, ends that die.
"""

from collections.abc import Callable
from random import Random
from typing import Any

from forefeel.common.clock import Clock
from forefeel.common.config import checked
from forefeel.common.lateness import Lateness
from forefeel.common.runtime.port import Tick
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.transport.impaired import ImpairedTransport
from forefeel.common.transport.memory import MemoryBus
from forefeel.master.daemon import MasterDaemon
from forefeel.master.settings import MasterSettings
from forefeel.slave.daemon import SlaveDaemon
from forefeel.slave.settings import SlaveSettings
from tests.network import Party, Traffic

S = 1_000_000_000
DELAY_S = 0.010
OVERSHOOT = 1.4
"""Overshoot of the simulated servo (2 w s + w^2) / (s + w)^2: 1 + 2 / e^2, the integral of its impulse
response without sign, and what a setpoint adds that is a tick ahead."""


class Cable:
    """A link of one delay that holds everything back (`stalls`) or loses it (`cuts`) in spans of time,
    in s of the virtual clock, and a share of all (`loss`).
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.delay_s = DELAY_S
        self.stalls: list[tuple[float, float]] = []
        self.cuts: list[tuple[float, float]] = []
        self.loss = 0.0
        self._random = Random("cable")

    def plan(self, now_ns: int) -> tuple[int, ...]:
        del now_ns  # of the host
        now_s = self._clock.now_ns() / S
        lost = self.loss > 0.0 and self._random.random() < self.loss
        if lost or any(start <= now_s < end for start, end in self.cuts):
            return ()
        waits_s = [end - now_s for start, end in self.stalls if start <= now_s < end]
        return (round((max(waits_s, default=0.0) + self.delay_s) * S),)


class Host:
    """The virtual runtime and its clock as they are on a host that was started at another time."""

    scheduling = "virtual time"

    def __init__(self, runtime: VirtualRuntime, offset_ns: int) -> None:
        self._runtime, self._offset_ns = runtime, offset_ns
        self.clock = self.timers = self
        self.compute, self.fault, self.on_fault = runtime.compute, runtime.fault, runtime.on_fault

    def now_ns(self) -> int:
        return self._runtime.clock.now_ns() + self._offset_ns

    def loop(self, name: str, period_ns: int, tick: Tick) -> Lateness:
        return self._runtime.loop(name, period_ns, lambda now_ns: tick(now_ns + self._offset_ns))

    def task(self, name: str, period_ns: int, tick: Tick) -> None:
        self._runtime.task(name, period_ns, lambda now_ns: tick(now_ns + self._offset_ns))

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        self._runtime.call_at(due_ns - self._offset_ns, action)

    def step(self, ahead_ns: int) -> None:
        """Sets the host's clock ahead, as one does that was suspended."""
        self._offset_ns += ahead_ns


class Pair:
    """A slave and a master, each on its own host with a cable for what comes in."""

    def __init__(
        self,
        slave: dict[str, Any] | None = None,
        master: dict[str, Any] | None = None,
        slave_clock_ns: int = 0,
    ) -> None:
        self.runtime = VirtualRuntime()
        self.to_slave, self.to_master = Cable(self.runtime.clock), Cable(self.runtime.clock)
        self._ids = Random("pair")
        self._bus = MemoryBus()
        self.traffic = Traffic(self._bus.session(self.runtime.clock))
        self._slave_settings = checked(SlaveSettings, slave or {}, "slave")
        self._master_settings = checked(MasterSettings, master or {}, "master")
        self.start_slave(slave_clock_ns)
        self.start_master()

    def start_slave(self, clock_ns: int = 0) -> None:
        """A new slave process on a host with that clock."""
        host = self.slave_host = Host(self.runtime, clock_ns)
        self.slave = SlaveDaemon(self._slave_settings, self._join(host, self.to_slave), host, self._new_id)

    def start_master(self) -> None:
        """A new master process."""
        host = self.master_host = Host(self.runtime, 0)
        self.master = MasterDaemon(
            self._master_settings, self._join(host, self.to_master), host, self._new_id
        )

    def stranger(self) -> Party:
        """Somebody else on the same network."""
        return Party(self._bus, self.runtime.clock, self.traffic)

    def run(self, duration_s: float) -> float:
        """Goes on; the time in s then."""
        self.runtime.run(round(duration_s * S))
        return self.runtime.clock.now_ns() / S

    def _join(self, host: Host, cable: Cable) -> ImpairedTransport:
        return ImpairedTransport(self._bus.session(host.clock), host, host.clock, cable, None)

    def _new_id(self) -> int:
        return self._ids.getrandbits(62) | 1
