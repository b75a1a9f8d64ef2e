"""Axes and a cell on the memory bus: fake devices that a test breaks, other ends whose messages it writes."""

from itertools import count
from typing import Any

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.estimation.learner import Learner
from forefeel.common.events.sink import NULL_EVENT_SINK, Detail, EventSink
from forefeel.common.messages import Grip, Handshake, HapticSample, MasterState, MotionCommand, SafetyState
from forefeel.common.runtime.virtual import VirtualRuntime
from forefeel.common.settings import AxisLimits, settings_hash
from forefeel.common.transport.memory import MemoryBus
from forefeel.devices.simulated.settings import SimulatedGripperSettings, SimulatedLoadCellSettings
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.master.axis import MasterAxis
from forefeel.master.handle import HandleReading, Indication
from forefeel.master.haptics import HapticLoop
from forefeel.master.prediction import ForcePrediction, IdentificationTask
from forefeel.master.settings import MasterAxisSettings, RenderingSettings
from forefeel.slave.axis import SlaveAxis
from forefeel.slave.daemon import Clearing, SlaveDaemon
from forefeel.slave.devices import Devices
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.settings import GateSettings, SlaveAxisSettings, SlaveSettings
from forefeel.slave.stage import StageReading
from tests.messages import SHARED
from tests.network import AXIS, CELL, Party

MS = 1_000_000
START_M = 0.02
SESSION = 41
FULL_SCALE_N = 10.0
SETTINGS = SlaveAxisSettings(
    gate=GateSettings(engage_ramp_s=0.02),
    stage=ZaberSettings(
        driver="zaber_ascii", port="none", microstep_m=1e-7, travel_m=(-1.0, 1.0), lag_s=0.02
    ),
    load_cell=SimulatedLoadCellSettings(),
    gripper=SimulatedGripperSettings(),
    unsafe=("gate.engage_ramp_s",),
)


class Book(EventSink):
    """An event sink in memory."""

    def __init__(self) -> None:
        self.noted: list[tuple[str, int, str, dict[str, Detail]]] = []
        self.flights: list[tuple[str, str]] = []
        self.broken: str | None = None  # why the latch can not be written

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        self.noted.append((event, now_ns, axis, details))

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        del reason, now_ns
        self.flights.append((axis, event))

    @property
    def problem(self) -> str | None:
        return self.broken

    def of(self, event: str) -> list[dict[str, Detail]]:
        return [details for name, _, _, details in self.noted if name == event]


class FakeDevice:
    """A device; calls whose names are in `broken` fail."""

    name = ""

    def __init__(self) -> None:
        self.broken = set[str]()
        self.opened = False

    def call(self, name: str) -> None:
        if name in self.broken:
            raise DeviceError(f"{self.name}: {name} refused")

    def open(self) -> None:
        self.call("open")
        self.opened = True

    def close(self) -> None:
        self.opened = False

    def rearm(self) -> None:
        self.call("rearm")


class FakeStage(FakeDevice):
    """Follows at once, unless it is stuck."""

    name = "stage"

    def __init__(self) -> None:
        super().__init__()
        self.position_m, self.velocity_m_s = START_M, 0.0
        self.travel_m = (-1.0, 1.0)
        self.commands = list[tuple[int, float, float]]()
        self.holds = list[int]()
        self.stuck = False

    def command(self, position_m: float, velocity_m_s: float, now_ns: int) -> float:
        self.call("command")
        self.commands.append((now_ns, position_m, velocity_m_s))
        applied_m = max(self.travel_m[0], min(self.travel_m[1], position_m))
        if not self.stuck:
            self.position_m, self.velocity_m_s = applied_m, velocity_m_s
        return applied_m

    def hold(self, now_ns: int) -> None:
        self.call("hold")
        self.holds.append(now_ns)
        self.velocity_m_s = 0.0

    def read(self, now_ns: int) -> StageReading:
        del now_ns
        self.call("read")
        return StageReading(self.position_m, self.velocity_m_s)


class FakeGripper(FakeDevice):
    name = "gripper"

    def __init__(self) -> None:
        super().__init__()
        self.asked = list[Grip]()

    def set(self, grip: Grip, now_ns: int) -> Grip:
        del now_ns
        self.call("set")
        self.asked.append(grip)
        return grip


class FakeLoadCell(FakeDevice):
    """Answers with `reading` at one call in `every`; notes the recording times that it was asked for."""

    name = "load cell"
    stale_s = 0.02
    full_scale_n = 5.0

    def __init__(self) -> None:
        super().__init__()
        self.reading = LoadCellReading(0.1, 100, True)
        self.asked = list[float | None]()
        self.every = 1

    def read(self, now_ns: int, recording_time_s: float | None) -> list[LoadCellReading]:
        del now_ns
        self.asked.append(recording_time_s)
        self.call("read")
        return [self.reading] if len(self.asked) % self.every == 0 else []


class FakeHandle(FakeDevice):
    """A hand that stays where the test puts it and feels at most 2 N."""

    name = "handle"
    finished = False
    clutched_out_s = 1.5
    actuator_delay_s = 0.0

    def __init__(self) -> None:
        super().__init__()
        self.reading = HandleReading(0.0, 0.0, True)
        self.felt_n = list[float]()
        self.shown = Indication(None, None)
        self.pressed_anew = False
        self.counters = {"frames_lost": 3}

    def rearm(self) -> None:
        self.call("rearm")
        self.pressed_anew = False

    def read(self, now_ns: int) -> HandleReading:
        del now_ns
        self.call("read")
        return self.reading

    def render(self, force_n: float, now_ns: int) -> float:
        del now_ns
        self.call("render")
        self.felt_n.append(max(-2.0, min(2.0, force_n)))
        return self.felt_n[-1]

    def show(self, indication: Indication) -> None:
        self.shown = indication


class FakePredictor(ForcePrediction):
    """A predictor whose answer the test decides; notes what it was asked."""

    def __init__(self) -> None:
        self.answer: float | None = 1.0
        self.stage_m = 0.0
        self.asked = list[tuple[int, float, float]]()
        self.held = False

    def predict(
        self, stamp_ns: int, position_m: float, velocity_m_s: float, deadman: bool, *_: object, **__: object
    ) -> Estimate | None:
        self.asked.append((stamp_ns, position_m, velocity_m_s))
        self.held = deadman
        if self.answer is None:
            return None
        return Estimate(self.answer, self.answer - 0.1, self.answer + 0.1, "friction")

    def reset(self) -> None:
        self.asked.clear()


class SlaveRig(Party):
    """A slave axis and a master whose messages a test writes. A millisecond per `step`; asyncio's tasks run
    at their rates.
    """

    def __init__(
        self, settings: SlaveAxisSettings = SETTINGS, event_sink: EventSink = NULL_EVENT_SINK
    ) -> None:
        super().__init__(MemoryBus(), VirtualClock(1000 * MS))
        self.stage, self.gripper, self.load_cell = FakeStage(), FakeGripper(), FakeLoadCell()
        devices = Devices(self.stage, self.gripper, self.load_cell)
        bus = Bus(self.network.session(self.clock), CELL, AXIS, self.clock)
        self.axis = SlaveAxis(CELL, settings, devices, bus, 99, event_sink)
        self.session_id = SESSION
        self.beating = True
        self.position_m = START_M
        self.deadman = False
        self.sends = True
        self.rate = 0.0
        self.fields: dict[str, Any] = {}
        self._ticks = 0

    def masters_ns(self, stamp_ns: int) -> int:
        """Stamp of the master's clock at one of the slave's; it gains `rate` s in a second."""
        return stamp_ns + round(stamp_ns * self.rate)

    def state(self) -> SafetyState:
        """Safety state as it is published now."""
        self.axis.report(self.now_ns)
        return self.newest(topics.SLAVE_STATE).state

    @property
    def reason(self) -> str:
        return self.newest(topics.SLAVE_STATE).reason

    def counters(self) -> dict[str, int]:
        self.axis._take_commands()
        self.axis.report(self.now_ns)
        return self.newest(topics.SLAVE_STATE).counters

    def shake(self, session_id: int | None = None, **changes: Any) -> Handshake:  # noqa: ANN401 - any field
        """Asks for a session; the slave's answer."""
        self.say(topics.MASTER_HANDSHAKE, self.session_id if session_id is None else session_id, **changes)
        self.axis.serve(self.now_ns)
        return self.newest(topics.SLAVE_HANDSHAKE)

    def beat(self) -> None:
        """Sends the master's heartbeat, which echoes the slave's newest: a network without delay."""
        echo = dict[str, int]()
        if beats := self.messages(topics.SLAVE_HEARTBEAT):
            stamp_ns = beats[-1].stamp_ns
            echo = {"echo_stamp_ns": stamp_ns, "echo_receive_ns": self.masters_ns(stamp_ns)}
        self.say(topics.MASTER_HEARTBEAT, self.session_id, self.masters_ns(self.now_ns), **echo)

    def next_command(self) -> MotionCommand:
        stamp_ns, fields = self.masters_ns(self.now_ns), {"deadman": self.deadman, **self.fields}
        return self.write(topics.COMMAND, self.session_id, stamp_ns, position_m=self.position_m, **fields)

    def command(self) -> MotionCommand:
        return self.send(topics.COMMAND, self.next_command())

    def stop(self, reason: str = "pressed") -> None:
        self.say(topics.EMERGENCY_STOP, 0, reason=reason)

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
        """Opens a session, until its clocks are compared: READY."""
        self.axis.open(self.now_ns)
        assert self.shake().accepted
        self.step(120)
        assert self.state() is SafetyState.READY, self.reason
        return self

    def armed(self) -> "SlaveRig":
        self.connected()
        self.position_m, self.deadman = self.stage.position_m, True
        self.step(40)
        assert self.state() is SafetyState.ARMED, self.reason
        return self


class MasterRig(Party):
    """A master axis at 1 kHz and a slave whose messages a test writes, 10 ms late."""

    def __init__(self) -> None:
        super().__init__(MemoryBus(), VirtualClock(1000 * MS))
        self.handle, self.predictor = FakeHandle(), FakePredictor()
        prediction = ForcePrediction(AxisLimits())
        self._axis_bus = Bus(self.network.session(self.clock), CELL, AXIS, self.clock)
        self.axis = MasterAxis(
            CELL,
            MasterAxisSettings(),
            self.handle,
            HapticLoop(self.predictor, RenderingSettings()),
            IdentificationTask(prediction, Learner(prediction.evaluator)),
            self._axis_bus,
            count(101).__next__,
        )
        self.force_n = 0.3

    def tell(self, topic: topics.Topic[Any], session_id: int | None = None, **fields: Any) -> None:  # noqa: ANN401
        """Publishes a message of the slave in the axis' session, or another one."""
        holder = self.axis.session.session_id if session_id is None else session_id
        self.say(topic, holder, **{"stamp_ns": self.now_ns - 10 * MS, **fields})

    def answer(self, accepted: bool = True, shared: str = SHARED, **changes: Any) -> None:  # noqa: ANN401
        asked = self.messages(topics.MASTER_HANDSHAKE)
        fields: dict[str, Any] = {
            "accepted": accepted, "settings": shared, "settings_hash": settings_hash(shared),
            "answers_stamp_ns": asked[-1].stamp_ns if asked else None, "full_scale_n": FULL_SCALE_N,
            "instance_id": 7,
        }  # fmt: skip
        self.tell(topics.SLAVE_HANDSHAKE, **fields | changes)

    def compare_clocks(self) -> None:
        """Exchanges two heartbeats, 10 ms each way."""
        for _ in range(2):
            self.axis.beat(self.now_ns)
            sent_ns = self.newest(topics.MASTER_HEARTBEAT).stamp_ns
            self.clock.set_ns(sent_ns + 20 * MS)
            self.tell(topics.SLAVE_HEARTBEAT, echo_stamp_ns=sent_ns, echo_receive_ns=sent_ns + 10 * MS)

    def say_state(self, state: SafetyState = SafetyState.ARMED, session_id: int | None = None) -> None:
        self.tell(topics.SLAVE_STATE, session_id, state=state, reason="", position_m=0.05, counters={})

    def say_force(self, session_id: int | None = None, **changes: Any) -> None:  # noqa: ANN401 - any field
        fields: dict[str, Any] = {"position_m": 0.05, "force_n": self.force_n}
        if commands := self.messages(topics.COMMAND):
            newest = commands[-1]
            fields |= {"answers_sequence": newest.sequence, "answers_stamp_ns": newest.stamp_ns}
        self.tell(topics.FORCE, session_id, **fields | changes)

    def push(self, ticks: int) -> None:
        """Moves the hand in by 3 mm/s: a force is felt by who pushes against it."""
        for _ in range(ticks):
            reading = self.handle.reading
            self.handle.reading = reading._replace(position_m=reading.position_m + 3e-6)
            self.step(1)

    def step(self, ticks: int = 1, state: SafetyState | None = SafetyState.ARMED, force: bool = True) -> None:
        for _ in range(ticks):
            self.clock.set_ns(self.now_ns + MS)
            if force:
                self.say_force()
            if state is not None:
                self.say_state(state)
            self.axis.tick(self.now_ns)
        self._axis_bus.end_batches(self.now_ns, last=True)

    @property
    def commands(self) -> list[MotionCommand]:
        return self.messages(topics.COMMAND)

    @property
    def haptics(self) -> list[HapticSample]:
        return self.messages(topics.HAPTICS)

    def shown(self) -> SafetyState | None:
        return self.handle.shown.state

    def reported(self) -> MasterState:
        """The master's state as it is published now."""
        self.axis.report(self.now_ns)
        return self.newest(topics.MASTER_STATE)


class Cell:
    """A slave daemon of two axes in virtual time, simulated unless a test replaces their devices."""

    def __init__(self) -> None:
        self.runtime, self.book, self.network = VirtualRuntime(), Book(), MemoryBus()
        settings = SlaveSettings(axes=(SlaveAxisSettings(), SlaveAxisSettings(name="rotation")))
        self.session = self.network.session(self.runtime.clock)
        self.daemon = SlaveDaemon(settings, self.session, self.runtime, lambda: 7, self.book)
        self.step()

    def step(self, ticks: int = 5) -> None:
        self.runtime.run(ticks * MS)

    def close(self) -> None:
        self.daemon.close(self.runtime.clock.now_ns())

    def states(self) -> list[SafetyState]:
        return [axis.state for axis in self.daemon.axes]

    def clear(self, axis: str | None = None) -> list[Clearing]:
        done = self.daemon.clear(axis)
        self.step()
        return done.result(0)
