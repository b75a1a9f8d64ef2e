"""Probes of the host for the doctor. Nothing stays changed, and no device is moved."""

import os
import shutil
import stat
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

from forefeel.common.bus import Bus
from forefeel.common.clock import MonotonicClock, now_utc
from forefeel.common.errors import ForefeelError
from forefeel.common.messages import MasterState, SlaveState
from forefeel.common.runtime.realtime import RealtimeThread, prepare_process
from forefeel.common.settings import TICK_NS
from forefeel.common.state.folder import LATCHED, holder
from forefeel.common.state.latch import latched
from forefeel.common.topics import MASTER_STATE, SLAVE_STATE
from forefeel.common.transport.security import Party, PartyFiles
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.configured_devices import ConfiguredDevice
from forefeel.probe.probe import Probed, probe
from forefeel.reachability import Reached, reach

_LISTENING_S = 1.5  # the rarer states come ten times a second


@dataclass(frozen=True, slots=True)
class LoopCheck:
    """Scheduling and memory that a 1 kHz loop was granted, and its lateness in us."""

    scheduling: str
    memory: str
    ticks: int
    missed: int
    p50_us: float
    p99_us: float
    max_us: float


@dataclass(frozen=True, slots=True)
class ClockState:
    """Clocks as one end sees them. `session`: it holds one; None of both numbers: not compared."""

    end: str
    axis: str
    session: bool
    offset_ns: int | None
    bound_ns: int | None


@dataclass(frozen=True, slots=True)
class CellStates:
    """States of a cell. `hint`: what is wrong with the way; `error`: why there are none."""

    states: Sequence[ClockState] = ()
    hint: str = ""
    error: str = ""


@dataclass(frozen=True, slots=True)
class Disk:
    """State of a folder that is there or is going to be; `mode`: None where it is not there yet."""

    writable: bool
    mode: int | None
    free_bytes: float


class HostProbe:
    """Probes of this host that the checks call."""

    def now(self) -> datetime:
        return now_utc()

    def running(self, state: Path) -> int | None:
        """Process id of the daemon that has this state folder; None without one."""
        return holder(state)

    def latched(self, state: Path) -> dict[str, str]:
        """Reasons by axis that the slave with this state folder has latched; under "" of all."""
        return latched(state / LATCHED)

    def loop(self, priority: int, seconds: float) -> LoopCheck:
        """Runs an idle 1 kHz loop for that time as a daemon would, and returns what it was granted and its
        lateness. The memory of this process stays locked.
        """
        memory, failures = prepare_process(), list[BaseException]()
        thread = RealtimeThread("doctor", TICK_NS, lambda _now_ns: None, MonotonicClock(), failures.append)
        thread.start(priority)
        time.sleep(seconds)
        thread.stop()
        late = thread.lateness
        p50, p99 = late.quantile_us(0.5), late.quantile_us(0.99)
        return LoopCheck(thread.scheduling, memory, late.ticks, late.missed, p50, p99, late.max_us)

    def reach(self, endpoint: str, identity: PartyFiles | None, other: str) -> Reached:
        return reach(endpoint, identity, other)

    def states(
        self, transport: TransportSettings, party: Party | None, cell: str, axes: Sequence[str]
    ) -> CellStates:
        """Listens for 1.5 s and returns the newest clock state of each end of each axis that was heard.
        `error` is set, and no states, where the transport can not be opened.
        """
        newest: dict[tuple[str, str], ClockState] = {}

        def take(end: str, axis: str, state: SlaveState | MasterState, receive_ns: int) -> None:
            del receive_ns
            session = state.session_id != 0
            newest[end, axis] = ClockState(end, axis, session, state.clock_offset_ns, state.clock_bound_ns)

        clock = MonotonicClock()
        try:
            zenoh = ZenohTransport.open(transport, clock, lambda _: None, party, insecure=True)
        except ForefeelError as error:
            return CellStates(error=str(error))
        try:
            for axis in axes:
                bus = Bus(zenoh, cell, axis, clock)
                bus.subscribe(SLAVE_STATE, partial(take, "slave", axis))
                bus.subscribe(MASTER_STATE, partial(take, "master", axis))
            time.sleep(_LISTENING_S)
            hint = zenoh.hint
        finally:
            zenoh.close()
        return CellStates([newest[key] for key in sorted(newest)], hint)

    def probe(self, device: ConfiguredDevice) -> Probed:
        return probe(device, 0.3, MonotonicClock())

    def disk(self, folder: Path) -> Disk:
        place = folder
        while not os.path.exists(place) and place != place.parent:  # noqa: PTH110 - Path's raises where one may not look
            place = place.parent
        mode = stat.S_IMODE(folder.stat().st_mode) if place == folder else None
        writable = place.is_dir() and os.access(place, os.W_OK | os.X_OK)
        return Disk(writable, mode, shutil.disk_usage(place).free)
