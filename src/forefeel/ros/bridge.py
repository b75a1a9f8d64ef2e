"""`forefeel ros`: a cell as a ROS 2 node, over DDS, over Zenoh, or both; a viewer in a process of its own."""

import socket
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

from forefeel.common.clock import Clock, MonotonicClock, now_utc
from forefeel.common.errors import CodecError, RunError
from forefeel.common.transport.security import Party
from forefeel.common.transport.zenoh_bus import ZenohTransport, set_workers
from forefeel.devices.servo.driver import POSITION
from forefeel.estop.network import EVERY_S, FOR_S, Stopper, all_stopped
from forefeel.interrupt import signal_flag
from forefeel.network_settings import ObserverSettings
from forefeel.reachability import cell_watch
from forefeel.ros.cdr import (
    DIAGNOSTIC_ARRAY,
    JOINT_STATE,
    STRING_STAMPED,
    RosType,
    read_joint_state,
    read_string_stamped,
)
from forefeel.ros.crtk import DIAGNOSTICS, SERVO_JP, STATE_COMMAND, RosFeed, Send, Take, ros_name
from forefeel.ros.zenoh_wire import ZenohWire
from forefeel.terminal import ask, say

_WORKERS = 4
"""Of Zenoh: a viewer has three links, and a daemon's 32 workers wake each other: 13.9 -> 13.1 % of a core."""
_LOOK_NS = 1_000_000_000  # between two looks at the readers, and two diagnostics
_SILENCE_NS = 5_000_000_000  # without a reader before it is said
_REPEAT_NS = 60_000_000_000  # until it is said again
_WRITER_NS = 1_000_000_000  # of silence after which another node may move the hand


class RosOptions(NamedTuple):
    """Wires and rights. `endpoint`: of a router for rmw_zenoh; `servo`: the socket of a handle by axis."""

    domain: int
    rate_hz: float
    dds: bool
    endpoint: str | None = None
    humble: bool = False
    accept_commands: bool = False
    servo: Mapping[str, Path] = {}


class RosWire(Protocol):
    """A way to ROS nodes; see `forefeel.ros.zenoh_wire`."""

    name: str

    @property
    def notice(self) -> str: ...
    @property
    def silence(self) -> str: ...
    def publisher(self, topic: str, kind: RosType) -> Send: ...
    def subscribe(self, topic: str, kind: RosType, take: Take) -> None: ...
    def readers(self) -> int: ...
    def remarks(self) -> list[str]: ...
    def close(self) -> None: ...


class Commands:
    """Commands of ROS nodes: `pause` is the emergency stop of the cell, `servo_jp` the hand at a handle.

    Attributes:
        stop_until_ns: until when a stop is repeated, unless every axis confirms it before; 0: none is wanted.
    """

    def __init__(self, stopper: Stopper, servo: Mapping[str, Path], clock: Clock) -> None:
        self.stop_until_ns = 0
        self._stopper, self._servo, self._clock = stopper, servo, clock
        self._writers: dict[str, tuple[bytes, int]] = {}
        self._refusals: Counter[tuple[str, str]] = Counter()

    def state_command(self, axis: str, payload: bytes, _writer: bytes) -> None:
        """Takes a state command: `pause` requests a stop of the cell, which `repeat_stop` publishes, and is
        printed; any other, or a malformed one, is refused.
        """
        try:
            command = read_string_stamped(payload)
        except CodecError as error:
            self._refuse(axis, STATE_COMMAND, str(error))
            return
        if command != "pause":
            self._refuse(axis, STATE_COMMAND, f"{command[:32]!r}, expected pause, the only one")
            return
        now_ns = self._stopper.asked_ns = self._clock.now_ns()
        self._stopper.reason = f"ROS: {STATE_COMMAND} pause of {axis}"
        self.stop_until_ns = now_ns + int(FOR_S * 1e9)
        say(f"ros: {axis}: pause: the cell stops")

    def repeat_stop(self, now_ns: int) -> None:
        """Publishes the stop, if one is wanted, and prints its outcome once all axes confirm it or 2 s have
        gone, which ends it; to be called every `EVERY_S`.
        """
        until_ns = self.stop_until_ns
        if not until_ns:
            return
        self._stopper.publish(now_ns)
        outcome = self._stopper.outcome()
        states = ", ".join(f"{axis} {state}" for axis, state in outcome.items()) or "no slave heard"
        if all_stopped(outcome):
            say(f"ros: stopped: {states}; latched until `forefeel clear` on the slave's host")
        elif now_ns >= until_ns:
            ask(f"ros: STOP NOT CONFIRMED ({states}): USE THE STOP OF THE MACHINE ITSELF")
        else:
            return
        if self.stop_until_ns == until_ns:  # else another pause has come meanwhile, from a thread
            self.stop_until_ns = 0

    def servo_jp(self, axis: str, payload: bytes, writer: bytes) -> None:
        """Sends a JointState's position and velocity to the socket of the axis' handle. Refuses a malformed
        one, one without a handle, and those of a second node until the first has been silent for 1 s.
        """
        now_ns = self._clock.now_ns()
        newest = self._writers.get(axis, (writer, 0))
        if newest[0] != writer and now_ns - newest[1] < _WRITER_NS:
            self._refuse(axis, SERVO_JP, "of a second node")
            return
        try:
            position_m, velocity_m_s = read_joint_state(payload)
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sending:
                sending.sendto(POSITION.pack(now_ns, position_m, velocity_m_s), str(self._servo[axis]))
        except CodecError as error:
            self._refuse(axis, SERVO_JP, str(error))
        except OSError as error:
            self._refuse(axis, SERVO_JP, f"no handle at {self._servo[axis]}: {error.strerror}")
        else:
            self._writers[axis] = writer, now_ns

    def _refuse(self, axis: str, topic: str, why: str) -> None:
        """Counts a refused command and prints why: the first of an axis and topic, then each power of ten."""
        self._refusals[axis, topic] += 1
        number = self._refusals[axis, topic]
        if str(number).rstrip("0") == "1":
            say(f"ros: {axis}: {topic} refused ({number}): {why}")


class ReaderWatch:
    """Watches the wires for ROS nodes that read them, from the start at `now_ns` on."""

    def __init__(self, wires: Sequence[RosWire], now_ns: int) -> None:
        self._due_ns = dict.fromkeys(wires, now_ns + _SILENCE_NS)

    def report(self, now_ns: int) -> None:
        """Prints the new remarks of each wire, and that nobody reads it: 5 s after the start or the last
        reader, then each minute.
        """
        for wire, due_ns in self._due_ns.items():
            number = wire.readers()
            for remark in wire.remarks():
                say(f"ros: {remark}")
            if number:
                self._due_ns[wire] = now_ns + _SILENCE_NS
            elif now_ns >= due_ns:
                say(f"ros: {wire.silence}")
                self._due_ns[wire] = now_ns + _REPEAT_NS


class Node:
    """A cell as a ROS node on all wires. A thread of the transport calls `hear`, the main one `look`.

    Attributes:
        sent: messages by topic.
    """

    def __init__(
        self, wires: Sequence[RosWire], cell: str, options: RosOptions, stopper: Stopper, clock: Clock
    ) -> None:
        self.sent: Counter[str] = Counter()
        self._wires, self._cell, self._options, self._stopper = wires, cell, options, stopper
        self._clock = clock
        self.commands = Commands(stopper, options.servo, clock)
        self.feed = RosFeed(cell, options.rate_hz, self._epoch_ns, self._advertise)
        self._send_diagnostics = self._advertise(DIAGNOSTICS, DIAGNOSTIC_ARRAY)
        self._readers, self._due_ns = ReaderWatch(wires, clock.now_ns()), 0
        self._servo_due_ns: int | None = clock.now_ns() + _SILENCE_NS

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Publishes the ROS messages of a payload that are due, and passes it to the stopper. At the first
        one of an axis subscribes to its commands, if the options accept any.
        """
        known = len(self.feed.axes)
        self.feed.hear(key, payload, receive_ns)
        self._stopper.hear(key, payload, receive_ns)
        if self._options.accept_commands and len(self.feed.axes) > known:
            self._accept(self.feed.axes[-1])

    def look(self, now_ns: int) -> None:
        """Repeats a stop that is wanted; each second publishes the diagnostics and reports missing readers.
        Prints once which handles of the options are missing, when an axis is heard, not before 5 s.
        """
        self.commands.repeat_stop(now_ns)
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + _LOOK_NS
            self._readers.report(now_ns)
            self._send_diagnostics(self.feed.diagnostics(now_ns), self._epoch_ns(now_ns))
        if self._servo_due_ns is not None and now_ns >= self._servo_due_ns and self.feed.axes:
            self._servo_due_ns = None
            self._check_servo()

    def _check_servo(self) -> None:
        """Prints each handle of the options whose axis is not heard, or that has no socket."""
        for axis, path in self._options.servo.items():
            if axis not in self.feed.axes:
                say(f"ros: --servo {axis}: no such axis is heard; expected {' or '.join(self.feed.axes)}")
            elif not path.is_socket():
                say(f"ros: {axis}: no handle at {path}; expected handle.socket of a master on this host")

    def _advertise(self, topic: str, kind: RosType) -> Send:
        """Makes a publisher of the topic on every wire; returns a function that counts and sends on all."""
        sends = [wire.publisher(topic, kind) for wire in self._wires]

        def send(payload: bytes, stamp_ns: int) -> None:
            self.sent[topic] += 1
            for put in sends:
                put(payload, stamp_ns)

        return send

    def _accept(self, axis: str) -> None:
        """Subscribes on every wire to the state command of an axis and, if the options name a handle for it,
        to its positions; prints that.
        """
        takers: dict[str, tuple[RosType, Callable[[str, bytes, bytes], None]]]
        takers = {STATE_COMMAND: (STRING_STAMPED, self.commands.state_command)}
        if axis in self._options.servo:
            takers[SERVO_JP] = JOINT_STATE, self.commands.servo_jp
        for topic, (kind, take) in takers.items():
            for wire in self._wires:
                wire.subscribe(ros_name(self._cell, axis, topic), kind, partial(take, axis))
        say(f"ros: {axis}: takes {', '.join(takers)}")

    def _epoch_ns(self, stamp_ns: int) -> int:
        return int(now_utc().timestamp() * 1e9) + stamp_ns - self._clock.now_ns()


@contextmanager
def _opened_wires(options: RosOptions, insecure: bool) -> Iterator[list[RosWire]]:
    """Opens the wires that are asked for, and prints their notices; closes them at the end."""
    wires: list[RosWire] = []
    try:
        if options.endpoint is not None:
            wires.append(ZenohWire(options.endpoint, options.domain, options.humble, insecure))
        if options.dds:
            from forefeel.ros.dds_wire import DdsWire  # noqa: PLC0415 - an extra

            wires.append(DdsWire(options.domain))
        for wire in wires:
            if wire.notice:
                say(f"ros: {wire.notice}")
        yield wires
    finally:
        for wire in wires:
            wire.close()


def run_ros(
    settings: ObserverSettings, options: RosOptions, duration_s: float | None, insecure: bool = False
) -> None:
    """Publishes a cell to ROS nodes, as a viewer, until SIGINT, SIGTERM, SIGHUP or the duration; prints why
    nobody of the cell is heard, or no node reads, and at the end what was sent.

    Raises:
        InputError: an endpoint or a certificate can not be used.
        RunError: the network failed.
    """
    set_workers(_WORKERS)
    clock, failed = MonotonicClock(), list[Exception]()
    party, cell = Party("viewer", (settings.cell,)), settings.cell
    opening = partial(ZenohTransport.open, settings.transport, clock, failed.append, party, insecure=insecure)
    with signal_flag() as stop, _opened_wires(options, insecure) as wires, closing(opening()) as transport:
        stopper = Stopper(transport, cell, (), "ros", "", listens=False)
        node = Node(wires, cell, options, stopper, clock)
        transport.subscribe_all(f"forefeel/{cell}", node.hear)
        if transport.notice:
            say(transport.notice)
        names = " and ".join(wire.name for wire in wires)
        say(f"ros: cell {cell} in domain {options.domain} over {names}; Ctrl-C ends")
        look = cell_watch(settings.transport, party, transport, clock)
        for _ in stop.polls(duration_s, EVERY_S):
            node.look(clock.now_ns())
            look(bool(node.feed.axes))
            if failed:
                error = failed[0]
                raise RunError(f"ros: the network failed: {type(error).__name__}: {error}") from error
    for topic, number in sorted(node.sent.items()):
        say(f"ros: {topic}: {number} sent")
