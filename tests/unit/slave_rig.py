"""A slave axis on the memory bus, with devices that a test breaks and a master that says what it is told."""

from typing import Any

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher
from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.common.events.sink import NULL_EVENT_SINK, EventSink
from forefeel.common.messages import (
    EmergencyStop,
    ForceSample,
    Grip,
    Handshake,
    Heartbeat,
    LimitEvent,
    MotionCommand,
    SafetyEvent,
    SafetyState,
    SlaveState,
)
from forefeel.common.settings import settings_hash, shared_text
from forefeel.common.topics import Qos
from forefeel.common.transport.memory import MemoryBus
from forefeel.common.transport.port import Put
from forefeel.devices.simulated.settings import SimulatedGripperSettings, SimulatedLoadCellSettings
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.slave.axis import SlaveAxis
from forefeel.slave.devices import Devices
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.settings import GateSettings, SlaveAxisSettings
from forefeel.slave.stage import StageReading

MS = 1_000_000
START_M = 0.02
SESSION = 41
_STAGE = ZaberSettings(driver="zaber_ascii", port="none", microstep_m=1e-7, travel_m=(-1.0, 1.0), lag_s=0.02)
SETTINGS = SlaveAxisSettings(
    gate=GateSettings(engage_ramp_s=0.02),
    stage=_STAGE,
    load_cell=SimulatedLoadCellSettings(),
    gripper=SimulatedGripperSettings(),
    unsafe=("gate.engage_ramp_s",),
)
SHARED = shared_text("cell", "insertion", SETTINGS.limits)


class FakeStage:
    """Follows at once, unless it is stuck. `broken` names the calls that fail."""

    def __init__(self) -> None:
        self.position_m, self.velocity_m_s = START_M, 0.0
        self.travel_m = (-1.0, 1.0)
        self.broken = set[str]()
        self.commands = list[tuple[int, float, float]]()
        self.holds = list[int]()
        self.opened = self.stuck = False

    def _call(self, name: str) -> None:
        if name in self.broken:
            raise DeviceError(f"stage: {name} refused")

    def open(self) -> None:
        self._call("open")
        self.opened = True

    def close(self) -> None:
        self.opened = False

    def rearm(self) -> None:
        self._call("rearm")

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        self._call("command")
        self.commands.append((now_ns, position_m, velocity_m_s))
        applied_m = max(self.travel_m[0], min(self.travel_m[1], position_m))
        if not self.stuck:
            self.position_m, self.velocity_m_s = applied_m, velocity_m_s
        return applied_m

    def hold(self, now_ns: int) -> None:
        self._call("hold")
        self.holds.append(now_ns)
        self.velocity_m_s = 0.0

    def read(self, now_ns: int) -> StageReading:
        del now_ns
        self._call("read")
        return StageReading(self.position_m, self.velocity_m_s)


class FakeGripper:
    def __init__(self) -> None:
        self.broken = False
        self.asked = list[Grip]()

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def set(self, grip: Grip, now_ns: int) -> Grip:
        del now_ns
        if self.broken:
            raise DeviceError("gripper: jammed")
        self.asked.append(grip)
        return grip


class FakeLoadCell:
    """Answers with `reading` at one call in `every`, or raises `error`; notes the recording times that it was
    asked for.
    """

    stale_s = 0.02
    full_scale_n = 5.0

    def __init__(self) -> None:
        self.reading = LoadCellReading(0.1, 100, True)
        self.error: Exception | None = None
        self.asked = list[float | None]()
        self.every = 1

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def rearm(self) -> None:
        pass

    def read(self, now_ns: int, recording_time_s: float | None) -> list[LoadCellReading]:
        del now_ns
        self.asked.append(recording_time_s)
        if self.error is not None:
            raise self.error
        return [self.reading] if len(self.asked) % self.every == 0 else []


class SlaveRig:
    """A millisecond per `step`; asyncio's tasks run at their rates."""

    def __init__(
        self, settings: SlaveAxisSettings = SETTINGS, event_sink: EventSink = NULL_EVENT_SINK
    ) -> None:
        self.clock = VirtualClock(1000 * MS)
        self.network = MemoryBus()
        self.stage, self.gripper, self.load_cell = FakeStage(), FakeGripper(), FakeLoadCell()
        devices = Devices(self.stage, self.gripper, self.load_cell)
        bus = Bus(self.network.session(self.clock), "cell", "insertion", self.clock)
        self.event_sink = event_sink
        self.axis = SlaveAxis("cell", settings, devices, bus, 99, event_sink)
        self._connect()
        self.session_id = SESSION
        self.beating = True
        self.position_m = START_M
        self.deadman = False
        self.sends = True
        self.rate = 0.0
        self.fields: dict[str, Any] = {}
        self._ticks = 0

    def _connect(self) -> None:
        session = self.network.session(self.clock)
        bus = Bus(session, "cell", "insertion", self.clock)
        self.publishers: dict[str, Publisher] = {
            topic.name: bus.publisher(topic)
            for topic in (
                topics.COMMAND, topics.MASTER_HANDSHAKE, topics.MASTER_HEARTBEAT, topics.EMERGENCY_STOP,
            )
        }  # fmt: skip
        self._puts = {
            name: session.publisher(topics.BY_NAME[name].taken_key("cell", "insertion"), Qos.STREAM)
            for name in self.publishers
        }
        self.forces, self.states = list[ForceSample](), list[SlaveState]()
        self.answers, self.beats = list[Handshake](), list[Heartbeat]()
        self.limits, self.events = list[LimitEvent](), list[SafetyEvent]()
        bus.subscribe(topics.FORCE, lambda m, _: self.forces.append(m))
        bus.subscribe(topics.SLAVE_STATE, lambda m, _: self.states.append(m))
        bus.subscribe(topics.SLAVE_HANDSHAKE, lambda m, _: self.answers.append(m))
        bus.subscribe(topics.SLAVE_HEARTBEAT, lambda m, _: self.beats.append(m))
        bus.subscribe(topics.LIMIT_EVENT, lambda m, _: self.limits.append(m))
        bus.subscribe(topics.SAFETY_EVENT, lambda m, _: self.events.append(m))

    def put_raw(self, topic: topics.Topic[Any], payload: bytes) -> None:
        """Bytes on a topic, whatever they are."""
        self._puts[topic.name](payload)

    def put_anything(self, topic: topics.Topic[Any]) -> Put:
        """A publisher of whoever else is on the network."""
        return self.network.session(self.clock).publisher(topic.taken_key("cell", "insertion"), Qos.STREAM)

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns()

    def masters_ns(self, stamp_ns: int) -> int:
        """What the master's clock shows at a stamp of the slave's; it gains `rate` s in a second."""
        return stamp_ns + round(stamp_ns * self.rate)

    def state(self) -> SafetyState:
        """As it is published now."""
        self.axis.report(self.now_ns)
        return self.states[-1].state

    def counters(self) -> dict[str, int]:
        self.axis._take_commands()
        self.axis.report(self.now_ns)
        return self.states[-1].counters

    def shake(self, session_id: int | None = None, **changes: Any) -> Handshake:  # noqa: ANN401 - any field
        """Asks for a session; the slave's answer."""
        session_id = self.session_id if session_id is None else session_id
        publisher = self.publishers[topics.MASTER_HANDSHAKE.name]
        fields: dict[str, Any] = {
            "role": "master",
            "instance_id": 1,
            "software": "forefeel",
            "settings_hash": settings_hash(SHARED),
            "settings": SHARED,
            **changes,
        }
        publisher.send(Handshake(**publisher.header(session_id, self.now_ns), **fields))
        self.axis.serve(self.now_ns)
        return self.answers[-1]

    def beat(self) -> None:
        """The master's heartbeat, echoing the slave's newest: a network without delay."""
        publisher = self.publishers[topics.MASTER_HEARTBEAT.name]
        echo = self.beats[-1].stamp_ns if self.beats else None
        header = publisher.header(self.session_id, self.masters_ns(self.now_ns))
        receive_ns = None if echo is None else self.masters_ns(echo)
        publisher.send(Heartbeat(**header, echo_stamp_ns=echo, echo_receive_ns=receive_ns))

    def command(self) -> MotionCommand:
        publisher = self.publishers[topics.COMMAND.name]
        fields: dict[str, Any] = {"velocity_m_s": 0.0, **self.fields}
        command = MotionCommand(
            **publisher.header(self.session_id, self.masters_ns(self.now_ns)),
            position_m=self.position_m,
            deadman=self.deadman,
            **fields,
        )
        publisher.send(command)
        return command

    def stop(self, source: str = "nurse", reason: str = "pressed") -> None:
        publisher = self.publishers[topics.EMERGENCY_STOP.name]
        publisher.send(EmergencyStop(**publisher.header(0, self.now_ns), source=source, reason=reason))

    def step(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self._ticks += 1
            self.clock.set_ns(self.now_ns + MS)
            if self.sends:
                self.command()
            self.axis.tick(self.now_ns)
            if self._ticks % 10 == 0:
                self.axis.serve(self.now_ns)
            if self._ticks % 20 == 0:
                self.axis.report(self.now_ns)
            if self._ticks % 50 == 0:
                self.axis.beat(self.now_ns)
                if self.beating:
                    self.beat()

    def connected(self) -> "SlaveRig":
        """A session whose clocks are compared: READY."""
        self.axis.open(self.now_ns)
        assert self.shake().accepted
        self.step(120)
        assert self.state() is SafetyState.READY, self.states[-1].reason
        return self

    def armed(self) -> "SlaveRig":
        self.connected()
        self.position_m, self.deadman = self.stage.position_m, True
        self.step(40)
        assert self.state() is SafetyState.ARMED, self.states[-1].reason
        return self
