from collections.abc import Iterator
from itertools import count, pairwise
from math import nan
from typing import Any

import pytest

from common import topics
from common.bus import Bus, Outlet
from common.clock import VirtualClock
from common.effects.model import ContactModel
from common.errors import DeviceError
from common.estimation.forecast import Estimate
from common.estimation.identification import ContactIdentifier, IdentificationSettings
from common.messages import (
    EmergencyStop,
    ForceSample,
    Grip,
    Handshake,
    HapticSample,
    Heartbeat,
    MasterState,
    MotionCommand,
    SafetyState,
    SlaveState,
)
from common.settings import AxisLimits, settings_hash, shared_text
from common.topics import Qos
from common.transport.memory import MemoryBus
from master.axis import MasterAxis
from master.handles.port import HandleReading, Indication
from master.haptics import HapticLoop
from master.identification import IdentificationTask
from master.prediction import Present
from master.session import Link
from master.settings import MasterAxisSettings, RenderingSettings

MS = 1_000_000
S = SafetyState
SHARED = shared_text("cell", "insertion", AxisLimits())
MODEL = ContactModel.from_mapping(
    {
        "schema": "forefeel.model/1",
        "name": "bias",
        "effects": [{"effect": "bias", "parameters": {"force_n": 0.0}}],
    }
)


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


class FakePredictor:
    def __init__(self) -> None:
        self.answer: float | None = 1.0

    def predict(self, present: Present) -> Estimate | None:
        del present
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
        self.learned = list[ForceSample]()
        ids = count(101)
        self.axis = MasterAxis(
            "cell",
            MasterAxisSettings(),
            self.handle,
            HapticLoop(self.predictor, RenderingSettings()),
            IdentificationTask(ContactIdentifier(MODEL, IdentificationSettings()), self._learn),
            Bus(network.session(self.clock), "cell", "insertion", self.clock),
            ids.__next__,
        )
        session = network.session(self.clock)
        bus = Bus(session, "cell", "insertion", self.clock)
        self.force, self.state, self.shake, self.beat = (
            bus.outlet(topic)
            for topic in (topics.FORCE, topics.SLAVE_STATE, topics.SLAVE_HANDSHAKE, topics.SLAVE_HEARTBEAT)
        )
        self.put_raw = session.publisher(topics.FORCE.key("cell", "insertion"), Qos.STREAM)
        self.commands, self.haptics = list[MotionCommand](), list[HapticSample]()
        self.states, self.asked = list[MasterState](), list[Handshake]()
        self.beats, self.stops = list[Heartbeat](), list[EmergencyStop]()
        bus.subscribe(topics.COMMAND, lambda m, _: self.commands.append(m))
        bus.subscribe(topics.HAPTICS, lambda m, _: self.haptics.append(m))
        bus.subscribe(topics.MASTER_STATE, lambda m, _: self.states.append(m))
        bus.subscribe(topics.MASTER_HANDSHAKE, lambda m, _: self.asked.append(m))
        bus.subscribe(topics.MASTER_HEARTBEAT, lambda m, _: self.beats.append(m))
        bus.subscribe(topics.EMERGENCY_STOP, lambda m, _: self.stops.append(m))
        self.slave_ns = 0  # the slave's clock minus the master's

    def _learn(self, sample: ForceSample) -> float:
        self.learned.append(sample)
        return sample.force_n

    @property
    def now_ns(self) -> int:
        return self.clock.now_ns()

    def header(self, outlet: Outlet, session_id: int | None = None) -> dict[str, Any]:
        holder = self.axis.session.session_id if session_id is None else session_id
        return {**outlet.header(holder, self.now_ns - 10 * MS + self.slave_ns)}

    def answer(self, accepted: bool = True, shared: str = SHARED, **changes: Any) -> None:  # noqa: ANN401
        fields: dict[str, Any] = {
            **self.header(self.shake),
            "role": "slave",
            "instance_id": 7,
            "software": "forefeel",
            "settings_hash": settings_hash(shared),
            "settings": shared,
            "accepted": accepted,
            **changes,
        }
        self.shake.send(Handshake(**fields))

    def say_state(self, state: S = S.ARMED, session_id: int | None = None) -> None:
        self.state.send(
            SlaveState(
                **self.header(self.state, session_id),
                state=state,
                reason="",
                position_m=0.05,
                velocity_m_s=0.0,
                gripper=Grip.CLOSED,
                stops=0,
                clock_offset_ns=None,
                clock_bound_ns=None,
                counters={},
            )
        )

    def say_force(self, session_id: int | None = None, **changes: Any) -> None:  # noqa: ANN401 - any field
        newest = self.commands[-1] if self.commands else None
        fields: dict[str, Any] = {
            **self.header(self.force, session_id),
            "position_m": 0.05,
            "velocity_m_s": 0.0,
            "force_n": 0.3,
            "raw_counts": 3,
            "valid": True,
            "answers_sequence": newest.sequence if newest else None,
            "answers_stamp_ns": newest.stamp_ns if newest else None,
            **changes,
        }
        self.force.send(ForceSample(**fields))

    def step(self, ticks: int = 1, state: S | None = S.ARMED, force: bool = True) -> None:
        for _ in range(ticks):
            self.clock.set_ns(self.now_ns + MS)
            if force:
                self.say_force()
            if state is not None:
                self.say_state(state)
            self.axis.tick(self.now_ns)

    def counters(self) -> dict[str, int]:
        self.axis.report(self.now_ns)
        return self.states[-1].counters


def shown(rig: Rig) -> SafetyState | None:
    return rig.handle.shown.state


@pytest.fixture
def rig() -> Iterator[Rig]:
    """With an open session."""
    rig = Rig()
    rig.axis.serve(rig.now_ns)
    rig.answer()
    assert rig.axis.session.link is Link.OPEN
    yield rig
    assert all(-2.0 <= force_n <= 2.0 for force_n in rig.handle.felt_n)


# --- sessions ---


def test_it_asks_with_its_settings_and_sends_nothing_else_before_the_answer() -> None:
    rig = Rig()
    rig.axis.serve(rig.now_ns)
    rig.step(50, state=None, force=False)
    rig.axis.beat(rig.now_ns)
    (asked,) = rig.asked
    assert (asked.role, asked.session_id, asked.settings) == ("master", 101, SHARED)
    assert asked.settings_hash == settings_hash(SHARED)
    assert (rig.commands, rig.haptics, rig.beats) == ([], [], [])


def test_an_accepting_slave_with_other_settings_is_not_believed() -> None:
    rig = Rig()
    rig.axis.serve(rig.now_ns)
    rig.answer(shared=shared_text("cell", "insertion", AxisLimits(max_force_n=30.0)))
    assert rig.axis.session.link is Link.MISMATCH
    assert rig.axis.session.reason == "settings differ: max_force_n: 3.0 here, 30.0 there"
    rig.clock.set_ns(rig.now_ns + 5000 * MS)
    rig.axis.serve(rig.now_ns)
    assert len(rig.asked) == 1
    rig.step(5)
    assert rig.commands == []


def test_a_refusal_is_shown_and_asked_again() -> None:
    rig = Rig()
    rig.axis.serve(rig.now_ns)
    rig.answer(accepted=False, reason="another session holds the lease")
    rig.axis.report(rig.now_ns)
    assert (rig.states[-1].indication, rig.states[-1].reason) == (
        "no_link",
        "another session holds the lease",
    )
    rig.clock.set_ns(rig.now_ns + 250 * MS)
    rig.axis.serve(rig.now_ns)
    assert [asked.session_id for asked in rig.asked] == [101, 101]


def test_heartbeats_echo_the_slaves_and_compare_the_clocks(rig: Rig) -> None:
    rig.slave_ns = 3000 * MS
    rig.axis.beat(rig.now_ns)
    sent_ns = rig.now_ns
    rig.clock.set_ns(sent_ns + 20 * MS)
    there_ns = sent_ns + 10 * MS + rig.slave_ns
    header = rig.header(rig.beat)
    rig.beat.send(Heartbeat(**header, echo_stamp_ns=sent_ns, echo_receive_ns=there_ns))
    rig.axis.report(rig.now_ns)
    assert (rig.states[-1].clock_offset_ns, rig.states[-1].clock_bound_ns) == (3000 * MS, 10 * MS)
    rig.axis.beat(rig.now_ns)
    assert (rig.beats[-1].echo_stamp_ns, rig.beats[-1].echo_receive_ns) == (header["stamp_ns"], rig.now_ns)
    rig.step(2)
    assert rig.haptics[-1].force_age_s == pytest.approx(0.010)


def test_a_session_that_the_slave_lost_is_replaced_and_nothing_of_it_is_felt(rig: Rig) -> None:
    rig.step(300)
    rig.step(1001, state=None, force=False)
    rig.axis.serve(rig.now_ns)
    assert (rig.axis.session.link, rig.axis.session.session_id) == (Link.ASKING, 103)
    sent = len(rig.commands)
    rig.step(5)
    assert len(rig.commands) == sent
    rig.answer()
    rig.step(1, state=None, force=False)
    assert rig.haptics[-1].held_n is None
    assert rig.handle.shown.state is None


def test_a_slave_whose_clock_began_anew_is_heard_after_the_handshake(rig: Rig) -> None:
    rig.step(100)
    rig.step(1001, state=None, force=False)
    rig.slave_ns = -(10**12)
    rig.axis.serve(rig.now_ns)
    rig.state.header(0, 0)  # its first state was lost
    rig.answer()
    rig.step(10)
    assert rig.handle.shown.state is S.ARMED
    assert rig.haptics[-1].held_n == 0.3


# --- forces and states ---


def test_forces_of_another_session_are_counted_and_not_used(rig: Rig) -> None:
    for session_id in (0, 5, 5):
        rig.say_force(session_id, position_m=0.9)
    rig.step(1, state=S.ARMED, force=False)
    assert rig.haptics[-1].held_n is None
    assert rig.handle.shown.stage_position_m is None
    assert rig.counters()["forces_of_another_session"] == 2


def test_a_force_that_was_overtaken_is_learned_from_but_not_shown(rig: Rig) -> None:
    rig.step(1)
    rig.say_force(force_n=0.8, position_m=0.06, stamp_ns=500)
    rig.say_force(force_n=0.9, position_m=0.07, stamp_ns=499)
    rig.step(1, force=False)
    assert rig.haptics[-1].held_n == 0.3
    assert rig.counters()["forces_reordered"] == 2
    assert len(rig.axis.identification.queue.drain()) == 3


def test_an_invalid_force_tells_the_position_but_is_not_held(rig: Rig) -> None:
    rig.step(1)
    rig.clock.set_ns(rig.now_ns + MS)
    rig.say_force(valid=False, force_n=9.0, position_m=0.055)
    rig.step(1, force=False)
    assert rig.haptics[-1].held_n == 0.3
    assert rig.handle.shown.stage_position_m == 0.055


def test_the_state_is_shown_until_half_a_second_after_the_last_word(rig: Rig) -> None:
    rig.step(1)
    rig.step(500, state=None)
    assert shown(rig) is S.ARMED
    rig.step(1, state=None)
    assert shown(rig) is None
    rig.axis.report(rig.now_ns)
    assert rig.states[-1].indication == "no_link"


def test_a_state_of_another_holder_is_no_state_of_ours(rig: Rig) -> None:
    rig.step(5)
    rig.clock.set_ns(rig.now_ns + MS)
    rig.say_state(S.ARMED, session_id=999)
    rig.step(1, state=None)
    assert shown(rig) is None


def test_a_state_that_was_overtaken_is_not_shown(rig: Rig) -> None:
    rig.step(5)
    old = SlaveState.model_validate(
        {**dict(_newest_state(rig)), "stamp_ns": 0, "state": S.READY, "sequence": 2}
    )
    rig.state.send(old)
    rig.step(1, state=None)
    assert rig.handle.shown.state is S.ARMED


def _newest_state(rig: Rig) -> SlaveState:
    state = rig.axis._slave_state
    assert state is not None
    return state


def test_malformed_forces_are_counted(rig: Rig) -> None:
    for payload in (b"", b"\xc1", b"\x80", b"x" * 70_000):
        rig.put_raw(payload)
    assert rig.counters()["malformed_slave_force"] == 4


# --- the hand ---


def test_what_is_published_is_what_the_handle_applied(rig: Rig) -> None:
    rig.predictor.answer = 3.5
    rig.step(400)
    assert rig.handle.felt_n[-1] == 2.0
    assert rig.haptics[-1].rendered_n == 2.0
    assert rig.haptics[-1].predicted_n == 3.5


def test_command_and_haptics_of_a_tick_carry_the_same_sequence(rig: Rig) -> None:
    rig.step(10)
    assert [m.sequence for m in rig.commands] == [m.sequence for m in rig.haptics] == list(range(1, 11))
    assert rig.haptics[-1].answered_sequence == 9
    assert rig.haptics[-1].delay_s == pytest.approx(0.001)


def test_a_prediction_that_is_no_number_does_not_end_the_loop(rig: Rig) -> None:
    rig.step(300)
    rig.predictor.answer = nan
    rig.step(201)
    assert (rig.haptics[-1].predicted_n, rig.haptics[-1].rendered_n) == (None, 0.0)


def test_when_it_is_stopped_the_deadman_opens_at_once_and_the_force_fades_without_a_jump(rig: Rig) -> None:
    rig.step(400)
    assert rig.commands[-1].deadman
    rig.axis.stopping = True
    before = len(rig.handle.felt_n) - 1
    rig.step(201)
    assert not any(command.deadman for command in rig.commands[-201:])
    steps = [abs(b - a) for a, b in pairwise(rig.handle.felt_n[before:])]
    assert max(steps) <= 0.04 + 1e-12
    assert rig.handle.felt_n[-1] == 0.0
    rig.axis.serve(rig.now_ns + 10_000 * MS)
    assert len(rig.asked) == 1


def test_at_a_fault_the_force_is_gone_at_once_and_stays_away(rig: Rig) -> None:
    rig.step(400)
    rig.axis.fail(ValueError("torn cable"))
    assert rig.handle.felt_n[-1] == 0.0
    rig.step(50)
    assert set(rig.handle.felt_n[-50:]) == {0.0}
    assert not rig.commands[-1].deadman
    assert rig.counters()["fault_ValueError"] == 1


def test_a_handle_that_can_not_even_let_go_is_counted(rig: Rig) -> None:
    rig.handle.broken = True
    rig.axis.fail(ValueError())
    rig.handle.broken = False
    assert rig.counters()["render_failed"] == 1


def break_handle(rig: Rig) -> None:
    rig.step(400)
    assert rig.commands[-1].deadman
    rig.handle.reading = HandleReading(0.012, 0.05, True)
    rig.step(1)
    rig.handle.broken = True


def test_a_handle_that_fails_is_let_go_in_the_same_tick_and_the_slave_hears_of_it(rig: Rig) -> None:
    break_handle(rig)
    at_m = rig.commands[-1].position_m
    rig.step(50)
    for command, haptics in zip(rig.commands[-50:], rig.haptics[-50:], strict=True):
        assert (command.deadman, command.velocity_m_s, haptics.rendered_n) == (False, 0.0, 0.0)
        assert haptics.handle_position_m == 0.012
    assert abs(rig.commands[-1].position_m - 0.05) < abs(at_m - 0.05) + 1e-12  # follows the stage
    rig.axis.report(rig.now_ns)
    state = rig.states[-1]
    assert (state.indication, state.reason, state.deadman) == ("handle_fault", "handle: unplugged", False)
    assert state.counters["handle_frames_lost"] == 3
    assert rig.axis.events.notices.drain() == [
        "handle: unplugged; let the deadman go and press it again to go on"
    ]


def test_a_handle_that_fails_while_it_renders_is_let_go_in_the_same_tick(rig: Rig) -> None:
    rig.step(400)
    whole = rig.handle.render

    def render(force_n: float, now_ns: int) -> float:
        rig.handle.broken = True
        return whole(force_n, now_ns)

    rig.handle.render = render  # type: ignore[method-assign]
    rig.step(1)
    assert (rig.commands[-1].deadman, rig.haptics[-1].rendered_n) == (False, 0.0)


def test_a_handle_that_answers_again_stays_let_go_until_the_deadman_is_pressed_anew(rig: Rig) -> None:
    break_handle(rig)
    rig.step(500)
    rig.handle.broken = False
    rig.handle.reading = HandleReading(0.030, 0.0, True)
    felt = len(rig.handle.felt_n)
    rig.step(100)
    assert not any(command.deadman for command in rig.commands[-600:])
    assert (rig.handle.rearmed, set(rig.handle.felt_n[felt:])) == (0, {0.0})
    rig.handle.pressed_anew = True
    rig.step(1)
    assert (rig.handle.rearmed, rig.commands[-1].deadman) == (1, False)
    assert rig.commands[-1].position_m == pytest.approx(0.05)  # the stage's, wherever the hand has gone
    rig.step(1)
    assert rig.commands[-1].deadman
    assert rig.commands[-1].position_m == pytest.approx(0.05)
    rig.step(300)
    steps = [abs(b - a) for a, b in pairwise(rig.handle.felt_n[felt:])]
    assert max(steps) <= 0.04 + 1e-12
    assert rig.handle.felt_n[-1] > 0.5
    rig.axis.report(rig.now_ns)
    assert rig.states[-1].indication == "armed"


def test_a_re_arming_that_fails_leaves_the_handle_let_go(rig: Rig) -> None:
    break_handle(rig)
    rig.step(10)

    def rearm() -> None:
        raise DeviceError("the link is closed")

    rig.handle.rearm = rearm  # type: ignore[method-assign]
    rig.handle.pressed_anew, rig.handle.broken = True, False
    rig.step(10)
    assert not rig.commands[-1].deadman
    rig.axis.report(rig.now_ns)
    assert rig.states[-1].reason == "handle: unplugged"


def test_an_emergency_stop_is_sent_with_its_reason(rig: Rig) -> None:
    rig.axis.emergency_stop("r" * 300, rig.now_ns)
    (stop,) = rig.stops
    assert (stop.source, stop.reason) == ("master", "r" * 256)


def test_the_time_that_the_person_chose_to_wait_is_published(rig: Rig) -> None:
    rig.axis.report(rig.now_ns)
    assert rig.states[-1].clutched_s == 1.5
