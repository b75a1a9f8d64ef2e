"""An emergency stop over the network, repeated until every axis of the cell confirms it."""

import socket
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher
from forefeel.common.clock import MonotonicClock
from forefeel.common.codec import decode
from forefeel.common.errors import CodecError
from forefeel.common.messages import EmergencyStop, SafetyState, SlaveState
from forefeel.common.settings import DaemonSettings
from forefeel.common.topics import SLAVE_STATE, checked_segment, parse_key
from forefeel.common.transport.port import Transport
from forefeel.common.transport.security import Party, PartyRole
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.daemon_settings import load_any
from forefeel.estop.client import reason_text
from forefeel.network_settings import ObserverSettings, observer
from forefeel.terminal import say

EVERY_S = 0.020  # s between two repetitions, as often as a master repeats its stop (`master/stop.py`)
FOR_S = 2.0  # s for which it is repeated, as long as a master repeats its stop that often (`master/stop.py`)
_SETTLED = 10  # repetitions without news, 0.2 s: ten periods in which another axis would send its state
_ANYWHERE = ("0.0.0.0", "[::]", "")
_NO_NAME = "unknown-host"


def all_stopped(states: Mapping[str, str]) -> bool:
    """True when there is an axis, and every one confirms the stop."""
    return set(states.values()) == {SafetyState.ESTOPPED.value}


@dataclass
class Stopper:
    """Publishes the stop for the named axes, or for every axis that is heard, and collects the states.

    `listens`: where no axis is named it subscribes to all states; else its owner passes them to `hear`.
    `states`: of each axis the newest, with its receive stamp. `asked_ns`: when the stop was asked for; a
    state received until then confirms nothing. `news`: set when an axis has another state than before.
    """

    transport: Transport
    cell: str
    axes: tuple[str, ...]
    source: str
    reason: str
    listens: bool = True
    asked_ns: int = 0
    states: dict[str, tuple[str, int]] = field(default_factory=dict)
    news: threading.Event = field(default_factory=threading.Event)
    _publishers: dict[str, Publisher] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Subscribes to the states of the named axes, for an end may hear no others, or of all."""
        for axis in self.axes:
            key = SLAVE_STATE.key(self.cell, axis)
            self.transport.subscribe(key, partial(self.hear, key))
        if self.listens and not self.axes:
            self.transport.subscribe_all(SLAVE_STATE.key(self.cell, "*"), self.hear)

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Stores the state of an axis as text, with a remark if its latch is not on the disk; sets `news`
        where it differs from the one before. Ignores other topics and what can not be decoded.
        """
        parsed = parse_key(key)
        if parsed is None or parsed[2] is not SLAVE_STATE:
            return
        try:
            decoded = decode(SlaveState, payload)
        except CodecError:
            return
        state = decoded.state.value + ("" if decoded.latch_persisted else ", NOT KEPT OVER A NEW START")
        before, _ = self.states.get(parsed[1], ("", 0))
        self.states[parsed[1]] = state, receive_ns
        if state != before:
            self.news.set()

    def publish(self, now_ns: int) -> None:
        """Publishes the stop once to each named axis, or to each that was heard where none is named."""
        for axis in self.axes or tuple(self.states):
            if axis not in self._publishers:
                bus = Bus(self.transport, self.cell, axis, MonotonicClock())
                self._publishers[axis] = bus.publisher(topics.EMERGENCY_STOP)
            publisher = self._publishers[axis]
            header = publisher.header(0, now_ns)
            publisher.send(EmergencyStop(**header, source=self.source, reason=self.reason))

    def outcome(self) -> dict[str, str]:
        """State by axis, `not heard` for a named one without any; axes that are not named count, too. One
        received before the stop was asked for has a remark, and so is no confirmation.
        """
        newest = tuple(self.states.items())  # at once: another thread adds to it
        states = {
            axis: state if receive_ns > self.asked_ns else f"{state} before, silent since"
            for axis, (state, receive_ns) in newest
        }
        return {**dict.fromkeys(self.axes, "not heard"), **states}


class StopSender(NamedTuple):
    """Identity and transport with which a stop is sent; `axes`: those that it knows of."""

    transport: TransportSettings
    role: PartyRole
    cell: str
    insecure: bool = False
    axes: tuple[str, ...] = ()


def stop_over_network(sender: StopSender, axes: tuple[str, ...], reason: str) -> dict[str, str]:
    """Publishes the stop every 20 ms, and at each change of a state, until all axes confirm it or 2 s have
    gone. Where no axis is named it waits for 0.2 s without a new axis or state, for others may send later.

    Returns the newest state of each axis as text, also when it is not confirmed (`all_stopped`).

    Raises:
        InputError: an endpoint, a certificate or a name can not be used.
    """
    cell = sender.cell
    for name in (cell, *axes):
        checked_segment(name, "name")
    clock, faults = MonotonicClock(), list[Exception]()
    party = Party(sender.role, (cell,))
    opened = ZenohTransport.open(sender.transport, clock, faults.append, party, insecure=sender.insecure)
    try:
        if opened.notice:
            say(opened.notice)
        host = socket.gethostname() or _NO_NAME
        source = "".join(c if c.isascii() and (c.isalnum() or c in "_.-") else "-" for c in host)[:64]
        stopper, start_s = Stopper(opened, cell, axes, source, reason_text(reason)), time.monotonic()
        unchanged = 0  # repetitions
        while True:
            stopper.publish(clock.now_ns())
            unchanged += 1
            if stopper.news.wait(EVERY_S):
                stopper.news.clear()
                unchanged = 0
            outcome = stopper.outcome()
            if all_stopped(outcome) and (axes or unchanged >= _SETTLED):
                stopper.publish(clock.now_ns())  # an earlier stop may have done it, and no link had this one
                return outcome
            if time.monotonic() - start_s > FOR_S:
                return outcome
    finally:
        opened.close()


def sender_of(config: Path, insecure: bool) -> StopSender:
    """Makes the sender of a stop by the settings file of a slave, a master or a viewer. For a daemon it has
    the names of the axes, and connects also where the daemon listens; for a viewer it has no axes.

    Raises:
        ConfigurationError: it is of nobody who may stop a cell, or wrong.
    """
    settings = load_any(config, "slave", "master", "viewer")
    if not isinstance(settings, DaemonSettings):
        assert isinstance(settings, ObserverSettings)
        return StopSender(settings.transport, "viewer", settings.cell, insecure)
    axes = tuple(axis.name for axis in settings.axes)
    return StopSender(_towards(settings), settings.role, settings.cell, insecure, axes)


def viewer(
    cell: str | None, connect: Sequence[str], pki: str | None, through_router: bool, insecure: bool
) -> StopSender:
    """Sender by the options of a viewer.

    Raises:
        ConfigurationError: one can not be used.
    """
    settings = observer(None, cell, connect, None if pki is None else Path(pki), through_router)
    return StopSender(settings.transport, "viewer", settings.cell, insecure)


def _towards(settings: DaemonSettings) -> TransportSettings:
    """Transport of a process beside the daemon of these settings: it connects to all and listens nowhere."""
    transport = settings.transport
    targets = (*transport.connect, *map(_near, transport.listen))
    return transport.model_copy(update={"listen": (), "connect": targets})


def _near(endpoint: str) -> str:
    protocol, _, rest = endpoint.partition("/")
    host, colon, port = rest.rpartition(":")
    near = "[::1]" if host == "[::]" else "127.0.0.1"
    return f"{protocol}/{near}{colon}{port}" if host in _ANYWHERE else endpoint
