"""A master axis with a hand and a slave that do what a test wants."""

from collections.abc import Iterator
from itertools import count
from typing import Any

from forefeel.common import topics
from forefeel.common.bus import Bus, Publisher, observed
from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.estimation.learner import Learner
from forefeel.common.messages import (
    EmergencyStop,
    Handshake,
    HapticSample,
    Heartbeat,
    MasterState,
    MotionCommand,
    SafetyState,
)
from forefeel.common.settings import AxisLimits, settings_hash, shared_text
from forefeel.common.topics import Qos
from forefeel.common.transport.memory import MemoryBus
from forefeel.master.axis import MasterAxis
from forefeel.master.handle import HandleReading, Indication
from forefeel.master.haptics import HapticLoop
from forefeel.master.prediction import ForcePrediction, IdentificationTask
from forefeel.master.session import SessionState
from forefeel.master.settings import MasterAxisSettings, RenderingSettings
from tests.unit.dashboard import said

MS = 1_000_000
S = SafetyState
FULL_SCALE_N = 10.0
SHARED = shared_text("cell", "insertion", AxisLimits())


class FakeHandle:
    """A hand that stands where the test puts it and feels at most 2 N."""

    def __init__(self) -> None:
        self.reading = HandleReading(0.0, 0.0, True)
        self.felt_n = list[float]()
        self.shown = Indication(None, None)
        self.broken = self.pressed_anew = False
        self.counters = {"frames_lost": 3}
        self.rearmed = 0
        self.finished = False
        self.clutched_out_s = 1.5

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def rearm(self) -> None:
        self.rearmed += 1
        self.pressed_anew = False

    def read(self, now_ns: int) -> HandleReading:
        del now_ns
        if self.broken:
            raise DeviceError("handle: unplugged")
        return self.reading

    def render(self, force_n: float, now_ns: int) -> float:
        del now_ns
        if self.broken:
            raise DeviceError("handle: unplugged")
        self.felt_n.append(max(-2.0, min(2.0, force_n)))
        return self.felt_n[-1]

    def show(self, indication: Indication) -> None:
        self.shown = indication


class FakePredictor(ForcePrediction):
    def __init__(self) -> None:
        self.answer: float | None = 1.0

    def predict(self, *_: object, **__: object) -> Estimate | None:
        if self.answer is None:
            return None
        return Estimate(self.answer, self.answer - 0.5, self.answer + 0.25, "friction")

    def reset(self) -> None:
        pass


class Rig:
    """A master axis at 1 kHz with a slave that says what a test wants, 10 ms late."""

    def __init__(self) -> None:
        self.clock = VirtualClock(1000 * MS)
        network = MemoryBus()
        self.handle, self.predictor = FakeHandle(), FakePredictor()
        prediction = ForcePrediction(AxisLimits())
        ids = count(101)
        self._bus = Bus(network.session(self.clock), "cell", "insertion", self.clock)
        self.axis = MasterAxis(
            "cell",
            MasterAxisSettings(),
            self.handle,
            HapticLoop(self.predictor, RenderingSettings()),
            IdentificationTask(prediction, Learner(prediction.evaluator)),
            self._bus,
            ids.__next__,
        )
        session = network.session(self.clock)
        bus = Bus(session, "cell", "insertion", self.clock)
        self.force, self.state, self.shake, self.beat = (
            bus.publisher(topic)
            for topic in (topics.FORCE, topics.SLAVE_STATE, topics.SLAVE_HANDSHAKE, topics.SLAVE_HEARTBEAT)
        )
        self.put_raw = session.publisher(topics.FORCE.taken_key("cell", "insertion"), Qos.STREAM)
        self.commands, self.haptics = list[MotionCommand](), list[HapticSample]()
        self.states, self.asked = list[MasterState](), list[Handshake]()
        self.beats, self.stops = list[Heartbeat](), list[EmergencyStop]()
        bus.subscribe(topics.COMMAND, lambda m, _: self.commands.append(m))
        session.subscribe(topics.HAPTICS.key("cell", "insertion"), self._observe)
        bus.subscribe(topics.MASTER_STATE, lambda m, _: self.states.append(m))
        bus.subscribe(topics.MASTER_HANDSHAKE, lambda m, _: self.asked.append(m))
        bus.subscribe(topics.MASTER_HEARTBEAT, lambda m, _: self.beats.append(m))
        bus.subscribe(topics.EMERGENCY_STOP, lambda m, _: self.stops.append(m))
        self.slave_ns = 0  # the slave's clock minus the master's
        self.force_n = 0.3

    def _observe(self, payload: bytes, receive_ns: int) -> None:
        self.haptics += [message for message, _ in observed(topics.HAPTICS, payload, receive_ns)]

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns()

    def header(self, publisher: Publisher, session_id: int | None = None) -> dict[str, Any]:
        holder = self.axis.session.session_id if session_id is None else session_id
        return {**publisher.header(holder, self.now_ns - 10 * MS + self.slave_ns)}

    def answer(self, accepted: bool = True, shared: str = SHARED, **changes: Any) -> None:  # noqa: ANN401
        fields: dict[str, Any] = {
            **self.header(self.shake),
            "role": "slave",
            "instance_id": 7,
            "software": "forefeel",
            "settings_hash": settings_hash(shared),
            "settings": shared,
            "accepted": accepted,
            "answers_stamp_ns": self.asked[-1].stamp_ns if self.asked else None,
            "full_scale_n": FULL_SCALE_N,
            **changes,
        }
        self.shake.send(Handshake(**fields))

    def compare_clocks(self) -> None:
        """Two exchanges of heartbeats, 10 ms each way."""
        for _ in range(2):
            self.axis.beat(self.now_ns)
            sent_ns = self.beats[-1].stamp_ns
            self.clock.set_ns(sent_ns + 20 * MS)
            there_ns = sent_ns + 10 * MS + self.slave_ns
            echo = {"echo_stamp_ns": sent_ns, "echo_receive_ns": there_ns}
            self.beat.send(Heartbeat(**self.header(self.beat), **echo))

    def say_state(self, state: S = S.ARMED, session_id: int | None = None) -> None:
        header = self.header(self.state, session_id)
        self.state.send(said.slave_state(**header, state=state, reason="", position_m=0.05, counters={}))

    def say_force(self, session_id: int | None = None, **changes: Any) -> None:  # noqa: ANN401 - any field
        newest = self.commands[-1] if self.commands else None
        answered = None if newest is None else (newest.sequence, newest.stamp_ns)
        fields = {
            **self.header(self.force, session_id),
            "position_m": 0.05,
            "force_n": self.force_n,
            **changes,
        }
        self.force.send(said.force(fields.pop("sequence"), fields.pop("stamp_ns"), answered, **fields))

    def push(self, ticks: int) -> None:
        """The hand moves in by 3 mm/s: a force is felt by who pushes against it."""
        for _ in range(ticks):
            reading = self.handle.reading
            self.handle.reading = reading._replace(position_m=reading.position_m + 3e-6)
            self.step(1)

    def step(self, ticks: int = 1, state: S | None = S.ARMED, force: bool = True) -> None:
        for _ in range(ticks):
            self.clock.set_ns(self.now_ns + MS)
            if force:
                self.say_force()
            if state is not None:
                self.say_state(state)
            self.axis.tick(self.now_ns)
        self._bus.end_batches(self.now_ns, last=True)

    def counters(self) -> dict[str, int]:
        self.axis.report(self.now_ns)
        return self.states[-1].counters


def shown(rig: Rig) -> SafetyState | None:
    return rig.handle.shown.state


def linked() -> Iterator[Rig]:
    """With an open session; whatever happened, the hand was never pushed with more than it may be."""
    rig = Rig()
    rig.axis.serve(rig.now_ns)
    rig.answer()
    assert rig.axis.session.state is SessionState.OPEN
    yield rig
    assert all(-2.0 <= force_n <= 2.0 for force_n in rig.handle.felt_n)
