"""Both daemons in virtual time with what a loopback run does not have: a cable to cut, hosts whose clocks
differ, ends that die.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from random import Random
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from forefeel.common.bus import Bus, observed
from forefeel.common.clock import Clock
from forefeel.common.codec import decode, encode
from forefeel.common.config import checked
from forefeel.common.lateness import Lateness
from forefeel.common.messages import Message
from forefeel.common.runtime.port import Pause, T, Tick
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.topics import BY_NAME, SAFETY_EVENT, SLAVE_STATE, Topic, direct, parse_key
from forefeel.common.transport.impaired import ImpairedTransport
from forefeel.common.transport.memory import MemoryBus, MemoryTransport
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.master.daemon import MasterDaemon
from forefeel.master.settings import MasterSettings
from forefeel.slave.daemon import SlaveDaemon
from forefeel.slave.settings import SlaveSettings

S = 1_000_000_000
AXIS = "insertion"
DELAY_S = 0.010
OVERSHOOT = 1.4
"""Of the simulated servo (2 w s + w^2) / (s + w)^2: 1 + 2 / e^2, the integral of its impulse response without
sign, and what a setpoint adds that is a tick ahead."""
M = TypeVar("M", bound=Message)
Payloads = list[tuple[str, bytes, int]]


class Heard:
    """What a recorder heard; each payload is decoded once."""

    def __init__(self, payloads: Payloads) -> None:
        self.payloads = payloads
        self._sorted = 0
        self._of_key: defaultdict[tuple[str, str], list[bytes]] = defaultdict(list)
        self._decoded: defaultdict[tuple[str, str], list[Any]] = defaultdict(list)

    def messages(self, topic: Topic[M], axis: str = AXIS) -> list[M]:
        self._sort()
        encoded, decoded = self._of_key[axis, topic.name], self._decoded[axis, topic.name]
        decoded += [decode(topic.message, payload) for payload in encoded[len(decoded) :]]
        return list(decoded)

    def _sort(self) -> None:
        for key, payload, _ in self.payloads[self._sorted :]:
            if (parsed := parse_key(key)) is not None:
                self._of_key[parsed[1], parsed[2].name].append(payload)
        self._sorted = len(self.payloads)

    def column(self, topic: Topic[Any], name: str, axis: str = AXIS) -> NDArray[np.float64]:
        """One field as float64; None is NaN."""
        return np.array([getattr(m, name) for m in self.messages(topic, axis)], dtype=np.float64)

    def events(self, axis: str = AXIS) -> list[tuple[float, str]]:
        """(time in s, event) of each transition of the slave's safety state."""
        return [(m.stamp_ns / S, m.event) for m in self.messages(SAFETY_EVENT, axis)]

    def times(self, event: str, axis: str = AXIS) -> list[float]:
        return [time_s for time_s, name in self.events(axis) if name == event]

    def armed_share(self, until_s: float, axis: str = AXIS) -> float:
        """Of the time from the first arming on."""
        states = [m.state.value for m in self.messages(SLAVE_STATE, axis) if m.stamp_ns < until_s * S]
        since = states[states.index("armed") :] if "armed" in states else []
        return since.count("armed") / len(since) if since else 0.0


def heard_in(loop: VirtualLoopback) -> Heard:
    return Heard([(key, encode(message), stamp_ns) for key, message, stamp_ns in loop.messages])


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


class HostClock:
    """The virtual clock as a host reads it that was started at another time."""

    def __init__(self, clock: Clock, offset_ns: int) -> None:
        self._clock, self._offset_ns = clock, offset_ns

    def step(self, ahead_ns: int) -> None:
        self._offset_ns += ahead_ns

    def now_ns(self) -> int:
        return self._clock.now_ns() + self._offset_ns


class Host:
    """The runtime of one host: the virtual one, with that host's clock."""

    scheduling = "virtual time"

    def __init__(self, runtime: VirtualRuntime, offset_ns: int) -> None:
        self._runtime, self._offset_ns = runtime, offset_ns
        self.clock = HostClock(runtime.clock, offset_ns)
        self.timers = self

    def loop(self, name: str, period_ns: int, tick: Tick) -> Lateness:
        return self._runtime.loop(name, period_ns, lambda now_ns: tick(now_ns + self._offset_ns))

    def task(self, name: str, period_ns: int, tick: Tick) -> None:
        self._runtime.task(name, period_ns, lambda now_ns: tick(now_ns + self._offset_ns))

    def call_at(self, due_ns: int, action: Callable[[], None]) -> None:
        self._runtime.call_at(due_ns - self._offset_ns, action)

    def compute(self, work: Callable[[Pause], T]) -> "Future[T]":
        return self._runtime.compute(work)

    def step(self, ahead_ns: int) -> None:
        """Sets the host's clock ahead, as one does that was suspended."""
        self._offset_ns += ahead_ns
        self.clock.step(ahead_ns)

    def fault(self, error: BaseException) -> None:
        self._runtime.fault(error)

    def on_fault(self, reaction: Callable[[BaseException], None]) -> None:
        self._runtime.on_fault(reaction)


class Pair:
    """A slave and a master, each on its own host with a cable for what comes in."""

    def __init__(
        self,
        slave: dict[str, Any] | None = None,
        master: dict[str, Any] | None = None,
        slave_clock_ns: int = 0,
        master_clock_ns: int = 0,
    ) -> None:
        self.runtime = VirtualRuntime()
        self.to_slave, self.to_master = Cable(self.runtime.clock), Cable(self.runtime.clock)
        self.payloads: Payloads = []
        self.heard = Heard(self.payloads)
        self._ids = Random("pair")
        self._bus = MemoryBus()
        recorder = self._bus.session(self.runtime.clock)
        recorder.subscribe_all("forefeel", self._observe)
        recorder.subscribe_all(direct("forefeel"), self._record)
        self._slave_settings = checked(SlaveSettings, slave or {}, "slave")
        self._master_settings = checked(MasterSettings, master or {}, "master")
        self.start_slave(slave_clock_ns)
        self.start_master(master_clock_ns)

    def _observe(self, key: str, payload: bytes, receive_ns: int) -> None:
        topic = BY_NAME[key.split("/", 3)[3]]
        if not topic.batched:
            self._record(key, payload, receive_ns)
        elif not topic.crosses:
            for message, stamp_ns in observed(topic, payload, receive_ns):
                self._record(key, encode(message), stamp_ns)

    def _record(self, key: str, payload: bytes, receive_ns: int) -> None:
        self.payloads.append((key.removeprefix(direct("")), payload, receive_ns))

    def start_slave(self, clock_ns: int = 0) -> None:
        """A new slave process on a host with that clock."""
        host = self.slave_host = Host(self.runtime, clock_ns)
        self.slave = SlaveDaemon(self._slave_settings, self._join(host, self.to_slave), host, self._new_id)

    def start_master(self, clock_ns: int = 0) -> None:
        """A new master process on a host with that clock."""
        host = self.master_host = Host(self.runtime, clock_ns)
        self.master = MasterDaemon(
            self._master_settings, self._join(host, self.to_master), host, self._new_id
        )

    def third(self) -> Bus:
        """The bus of somebody else, on the first axis."""
        return Bus(self._bus.session(self.runtime.clock), "cell", AXIS, self.runtime.clock)

    def stranger(self) -> MemoryTransport:
        """Somebody else on the same network, whatever he puts."""
        return self._bus.session(self.runtime.clock)

    def run(self, duration_s: float) -> float:
        """Goes on; the time in s then."""
        self.runtime.run(round(duration_s * S))
        return self.runtime.clock.now_ns() / S

    def _join(self, host: Host, cable: Cable) -> ImpairedTransport:
        return ImpairedTransport(self._bus.session(host.clock), host, host.clock, cable, None)

    def _new_id(self) -> int:
        return self._ids.getrandbits(62) | 1


def write_csv(path: Path, names: str, columns: Sequence[NDArray[np.float64]]) -> Path:
    np.savetxt(path, np.column_stack(list(columns)), fmt="%.9f", delimiter=",", header=names, comments="")
    return path
