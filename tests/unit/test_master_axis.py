"""A master axis: sessions, forces and states that arrive, the hand, its faults, stops."""

from collections.abc import Iterator
from itertools import pairwise
from math import nan
from typing import Any

import pytest

from forefeel.common import topics
from forefeel.common.messages import MOST_COUNT, MOST_FORCE_N, PROTOCOL_VERSION, SafetyState
from forefeel.common.settings import AxisLimits, settings_hash, shared_text
from forefeel.master.handle import _REVERSED, HandleReading
from forefeel.master.session import SessionState
from forefeel.master.stop import StopRequest
from tests.messages import SHARED, usual
from tests.unit.rigs import FULL_SCALE_N, MS, MasterRig

S = SafetyState


@pytest.fixture
def rig() -> Iterator[MasterRig]:
    """Rig with an open session; checks at its end that the hand was never pushed with more than it may be."""
    rig = MasterRig()
    rig.axis.serve(rig.now_ns)
    rig.answer()
    assert rig.axis.session.state is SessionState.OPEN
    yield rig
    assert all(-2.0 <= force_n <= 2.0 for force_n in rig.handle.felt_n)


def test_it_asks_with_its_settings_and_sends_nothing_else_before_the_answer() -> None:
    rig = MasterRig()
    rig.axis.serve(rig.now_ns)
    rig.step(50, state=None, force=False)
    rig.axis.beat(rig.now_ns)
    (asked,) = rig.messages(topics.MASTER_HANDSHAKE)
    assert (asked.role, asked.session_id, asked.settings) == ("master", 101, SHARED)
    assert asked.settings_hash == settings_hash(SHARED)
    for topic in (topics.COMMAND, topics.HAPTICS, topics.MASTER_HEARTBEAT):
        assert rig.messages(topic) == []


OLDER = SHARED.replace(f'"protocol": {PROTOCOL_VERSION}', '"protocol": 5')
OTHERS = shared_text("cell", "insertion", AxisLimits(max_force_n=30.0))


@pytest.mark.parametrize(
    ("shared", "changes", "cause"),
    [
        (OLDER, {"protocol": 5}, f"protocol: {PROTOCOL_VERSION} here, 5 there: "),
        (
            shared_text("cell", "insertion", AxisLimits(max_force_n=30.0)),
            {},
            "max_force_n: 3.0 here, 30.0 there",
        ),
    ],
    ids=["protocol", "settings"],
)
def test_slave_with_other_settings_is_not_believed(shared: str, changes: dict[str, Any], cause: str) -> None:
    rig = MasterRig()
    rig.axis.serve(rig.now_ns)
    rig.answer(shared=shared, **changes)
    assert rig.axis.session.state is SessionState.MISMATCH
    assert rig.axis.session.cause(rig.now_ns).startswith(f"settings differ: {cause}")
    rig.clock.set_ns(rig.now_ns + 5000 * MS)
    rig.axis.serve(rig.now_ns)
    assert len(rig.messages(topics.MASTER_HANDSHAKE)) == 1
    rig.step(5)
    assert rig.commands == []


def test_forces_and_states_of_another_session_are_not_used(rig: MasterRig) -> None:
    for session_id in (0, 5, 5):
        rig.say_force(session_id, position_m=0.9)
    rig.step(1, state=S.ARMED, force=False)
    assert rig.haptics[-1].zoh_n is None
    assert rig.handle.shown.stage_position_m is None
    assert rig.reported().counters["forces_of_another_session"] == 2
    rig.step(5)
    assert rig.shown() is S.ARMED
    rig.clock.set_ns(rig.now_ns + MS)
    rig.say_state(S.ARMED, session_id=999)
    rig.step(1, state=None)
    assert rig.shown() is None


@pytest.fixture
def felt(rig: MasterRig) -> MasterRig:
    """The rig, in whose hand is a force of 1 N."""
    rig.compare_clocks()
    rig.push(400)
    assert rig.handle.felt_n[-1] == 1.0
    return rig


def test_a_session_that_the_slave_lost_is_replaced_and_nothing_of_it_is_felt(rig: MasterRig) -> None:
    rig.step(300)
    rig.step(1001, state=None, force=False)
    rig.axis.serve(rig.now_ns)
    assert (rig.axis.session.state, rig.axis.session.session_id) == (SessionState.ASKING, 103)
    sent = len(rig.commands)
    rig.step(5)
    assert len(rig.commands) == sent
    rig.answer()
    rig.step(1, state=None, force=False)
    assert rig.haptics[-1].zoh_n is None
    assert rig.shown() is None


def test_force_beyond_the_load_cell_is_counted_and_reaches_neither_hand_nor_predictor(rig: MasterRig) -> None:
    rig.step(1)
    for force_n in (FULL_SCALE_N, 1.001 * FULL_SCALE_N, -MOST_FORCE_N):
        rig.clock.set_ns(rig.now_ns + MS)
        rig.say_force(force_n=force_n)
    rig.step(1, force=False)
    assert rig.haptics[-1].zoh_n == FULL_SCALE_N
    assert rig.reported().counters["forces_out_of_range"] == 2
    assert [sample.force_n for sample in rig.axis.identification.queue.drain()] == [0.3, FULL_SCALE_N]


def test_a_force_that_was_overtaken_is_learned_from_but_not_shown(rig: MasterRig) -> None:
    rig.step(1)
    rig.say_force(force_n=0.8, position_m=0.06, stamp_ns=500)
    rig.say_force(force_n=0.9, position_m=0.07, stamp_ns=499)
    rig.step(1, force=False)
    assert rig.haptics[-1].zoh_n == 0.3
    assert rig.reported().counters["forces_reordered"] == 2
    assert len(rig.axis.identification.queue.drain()) == 3


def test_the_state_is_shown_until_half_a_second_after_the_last_word(rig: MasterRig) -> None:
    rig.step(1)
    rig.step(500, state=None)
    assert rig.shown() is S.ARMED
    rig.step(1, state=None)
    assert rig.shown() is None
    assert rig.reported().indication == "no_session"


def test_what_is_published_is_what_the_handle_applied(felt: MasterRig) -> None:
    felt.predictor.answer, felt.force_n = 3.5, 3.0
    felt.push(400)
    assert felt.handle.felt_n[-1] == 2.0
    assert (felt.haptics[-1].rendered_n, felt.haptics[-1].predicted_n) == (2.0, 3.5)


def test_command_and_haptics_of_a_tick_carry_the_same_sequence(rig: MasterRig) -> None:
    rig.step(10)
    assert [m.sequence for m in rig.commands] == [m.sequence for m in rig.haptics] == list(range(1, 11))
    assert rig.haptics[-1].answered_sequence == 9
    assert rig.haptics[-1].delay_s == pytest.approx(0.001)


def test_at_a_stop_the_deadman_opens_at_once_and_the_force_fades_without_a_jump(felt: MasterRig) -> None:
    felt.axis.stopping = True
    before = len(felt.handle.felt_n) - 1
    felt.step(201)
    assert not any(command.deadman for command in felt.commands[-201:])
    steps = [abs(b - a) for a, b in pairwise(felt.handle.felt_n[before:])]
    assert max(steps) <= 0.08 + 1e-12
    assert felt.handle.felt_n[-1] == 0.0
    felt.axis.serve(felt.now_ns + 10_000 * MS)
    assert len(felt.messages(topics.MASTER_HANDSHAKE)) == 1


def test_at_a_fault_the_force_is_gone_at_once_and_stays_away(felt: MasterRig) -> None:
    felt.axis.fail(ValueError("torn cable"))
    assert felt.handle.felt_n[-1] == 0.0
    felt.step(50)
    assert set(felt.handle.felt_n[-50:]) == {0.0}
    assert not felt.commands[-1].deadman
    assert felt.reported().counters["fault_ValueError"] == 1


def test_a_handle_that_fails_is_let_go_in_the_same_tick_until_it_is_rearmed(rig: MasterRig) -> None:
    rig.push(400)
    assert rig.commands[-1].deadman
    rig.handle.reading = HandleReading(0.012, 0.05, True)
    rig.step(1)
    at_m = rig.commands[-1].position_m
    rig.handle.broken = {"read", "render", "rearm"}
    rig.step(50)
    for command, haptics in zip(rig.commands[-50:], rig.haptics[-50:], strict=True):
        assert (command.deadman, command.velocity_m_s, haptics.rendered_n) == (False, 0.0, 0.0)
        assert haptics.handle_position_m == 0.012
    assert abs(rig.commands[-1].position_m - 0.05) < abs(at_m - 0.05) + 1e-12  # follows the stage
    state = rig.reported()
    assert (state.indication, state.reason, state.deadman) == ("handle_fault", "handle: read refused", False)
    assert state.counters["handle_frames_lost"] == 3
    (notice,) = rig.axis.events.notices.drain()
    assert notice.startswith("handle: read refused; ")
    rig.axis.serve(rig.now_ns)
    assert rig.axis.faulted
    rig.handle.pressed_anew, rig.handle.broken = True, {"rearm"}
    rig.step(10)
    assert not any(command.deadman for command in rig.commands[-60:])
    assert rig.reported().reason == "handle: read refused"


@pytest.mark.parametrize("fault", [None, _REVERSED, "handle: it was out of range"])
def test_button_stops_whatever_else_is_wrong_with_a_handle_that_answers(
    rig: MasterRig, fault: str | None
) -> None:
    """Without a fault before, the reading itself is out of range."""
    rig.axis._hand.fault = fault
    rig.handle.pressed_anew, rig.handle.broken = True, {"rearm"}
    rig.handle.reading = HandleReading(0.0, nan if fault is None else 0.0, True, estop=True)
    rig.step(1)
    assert len(rig.messages(topics.EMERGENCY_STOP)) == 1
    assert not rig.commands[-1].deadman
    assert rig.reported().indication == "handle_fault"


SECOND_NS = 1000 * MS


def requests(request: StopRequest, start_ns: int, end_ns: int) -> int:
    return sum(request.due(now_ns, None, 0, None) for now_ns in range(start_ns, end_ns, MS))


def test_a_stop_is_said_every_20_ms_for_2_s_then_seldom_until_a_newer_state_shows_it() -> None:
    request = StopRequest()
    assert requests(request, 0, 100 * MS) == 0
    assert request.ask("first", SECOND_NS)
    assert not request.ask("second", SECOND_NS)
    assert request.reason == "first"
    assert requests(request, SECOND_NS, 3 * SECOND_NS) == 100
    assert requests(request, 3 * SECOND_NS + MS, 13 * SECOND_NS) == 40
    heard: list[tuple[int, dict[str, Any], bool]] = [
        (1900, {"state": "estopped"}, False),
        (2500, {"state": "fault"}, False),
        (2500, {"state": "estopped", "latch_persisted": False}, False),
        (2500, {"state": "estopped"}, True),
    ]
    for number, (heard_ms, state, ends) in enumerate(heard):
        now_ns, heard_ns = (14 + number) * SECOND_NS, SECOND_NS + heard_ms * MS
        assert request.due(now_ns, usual(topics.SLAVE_STATE, **state), heard_ns, None) != ends
        assert request.wanted != ends
    assert request.ask("again", 20 * SECOND_NS)


def test_state_made_before_the_stop_can_have_arrived_does_not_acknowledge_it(rig: MasterRig) -> None:
    """Its 10 ms each way, of clocks that are compared; a second request needs a state of its own."""
    rig.compare_clocks()
    rig.axis.emergency_stop("smoke", rig.now_ns)
    asked_ns = rig.now_ns

    def wanted(made_ms: int) -> bool:
        rig.clock.set_ns(asked_ns + (made_ms + 10) * MS)
        rig.say_state(S.ESTOPPED)
        rig.axis.send_stop(rig.now_ns)
        return rig.axis.stop.wanted

    assert [wanted(made_ms) for made_ms in (-8, 1, 10)] == [True] * 3
    rig.axis.emergency_stop("fire", asked_ns + 20 * MS)
    assert [wanted(made_ms) for made_ms in (11, 30, 31)] == [True, True, False]
    assert len(rig.messages(topics.EMERGENCY_STOP)) == 3


def test_the_handle_s_button_stops_and_lets_the_deadman_go_as_long_as_it_is_held(rig: MasterRig) -> None:
    rig.handle.reading = rig.handle.reading._replace(deadman=True)
    rig.step(5)
    assert [command.deadman for command in rig.commands[-3:]] == [True] * 3
    rig.handle.reading = rig.handle.reading._replace(estop=True)
    rig.step(1)
    assert [command.deadman for command in rig.commands[-1:]] == [False]
    assert [stop.reason for stop in rig.messages(topics.EMERGENCY_STOP)] == ["the handle's button"]
    for _ in range(100):
        rig.step(1)
        rig.axis.send_stop(rig.now_ns)
    assert len(rig.messages(topics.EMERGENCY_STOP)) >= 5
    assert not any(command.deadman for command in rig.commands[-100:])


def test_button_that_stays_in_asks_once_without_a_session_and_again_after_a_clearing() -> None:
    rig = MasterRig()
    rig.handle.reading = rig.handle.reading._replace(estop=True)

    def asked(state: S, ticks: int) -> int:
        for _ in range(ticks):
            rig.clock.set_ns(rig.now_ns + MS)
            rig.say_state(state, session_id=0)
            rig.axis.tick(rig.now_ns)
        return len(rig.axis.events.notices.drain())

    assert [asked(S.ESTOPPED, 2500), asked(S.IDLE, 10)] == [1, 1]
    assert len(rig.messages(topics.EMERGENCY_STOP)) == 102  # every 20 ms for 2 s, then no more


@pytest.mark.parametrize("state", list(S))
def test_slave_in_fault_or_stopped_keeps_the_session_out_of_the_prior(rig: MasterRig, state: S) -> None:
    rig.step(5, state=state)
    rig.step(5)
    assert rig.axis.faulted is (state in {S.FAULT, S.ESTOPPED})


def test_no_number_and_no_name_of_the_slave_keeps_a_report_from_being_sent(rig: MasterRig) -> None:
    rules = ["force", "force", "r" * 64, *(f"rule_{n}" for n in range(300))]
    for sequence, rule in enumerate(rules):
        rig.axis.events._on_limit(
            usual(topics.LIMIT_EVENT, sequence=sequence, rule=rule, count=MOST_COUNT), rig.now_ns
        )
    counters = rig.reported().counters
    assert counters["limit_force"] == counters["limit_other"] == MOST_COUNT
    assert len(counters) < 100


def test_what_the_slave_does_without_is_said_once(rig: MasterRig) -> None:
    rig.axis.events.notices.drain()
    for caveats in ((), ("unsafe: gate.lease_s = 5",), ("unsafe: gate.lease_s = 5",)):
        rig.clock.set_ns(rig.now_ns + MS)
        rig.tell(topics.SLAVE_STATE, caveats=caveats)
    assert rig.axis.events.notices.drain() == ["slave: unsafe: gate.lease_s = 5"]
