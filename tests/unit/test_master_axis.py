"""A master axis: sessions, forces and states that arrive, the hand, its faults, stops."""

from collections.abc import Iterator
from itertools import pairwise

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.messages import MOST_COUNT, MOST_FORCE_N, PROTOCOL_VERSION, SafetyState
from forefeel.common.settings import AxisLimits, settings_hash, shared_text
from forefeel.common.topics import (
    COMMAND,
    EMERGENCY_STOP,
    HAPTICS,
    LIMIT_EVENT,
    MASTER_HANDSHAKE,
    MASTER_HEARTBEAT,
    SLAVE_STATE,
)
from forefeel.master.handle import HandleReading
from forefeel.master.session import SessionState
from forefeel.master.stop import StopRequest
from tests.messages import SHARED, usual
from tests.unit.failing import refusing
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
    (asked,) = rig.messages(MASTER_HANDSHAKE)
    assert (asked.role, asked.session_id, asked.settings) == ("master", 101, SHARED)
    assert asked.settings_hash == settings_hash(SHARED)
    assert [rig.messages(topic) for topic in (COMMAND, HAPTICS, MASTER_HEARTBEAT)] == [[], [], []]


def test_a_slave_of_another_protocol_is_not_believed_and_named() -> None:
    rig = MasterRig()
    rig.axis.serve(rig.now_ns)
    rig.answer(protocol=5, shared=SHARED.replace(f'"protocol": {PROTOCOL_VERSION}', '"protocol": 5'))
    cause = rig.axis.session.cause(rig.now_ns)
    assert cause.startswith(f"settings differ: protocol: {PROTOCOL_VERSION} here, 5 there: ")


def test_an_accepting_slave_with_other_settings_is_not_believed() -> None:
    rig = MasterRig()
    rig.axis.serve(rig.now_ns)
    rig.answer(shared=shared_text("cell", "insertion", AxisLimits(max_force_n=30.0)))
    assert rig.axis.session.state is SessionState.MISMATCH
    assert rig.axis.session.cause(rig.now_ns) == "settings differ: max_force_n: 3.0 here, 30.0 there"
    rig.clock.set_ns(rig.now_ns + 5000 * MS)
    rig.axis.serve(rig.now_ns)
    assert len(rig.messages(MASTER_HANDSHAKE)) == 1
    rig.step(5)
    assert rig.commands == []


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


def test_forces_of_another_session_are_counted_and_not_used(rig: MasterRig) -> None:
    for session_id in (0, 5, 5):
        rig.say_force(session_id, position_m=0.9)
    rig.step(1, state=S.ARMED, force=False)
    assert rig.haptics[-1].zoh_n is None
    assert rig.handle.shown.stage_position_m is None
    assert rig.reported().counters["forces_of_another_session"] == 2


def test_a_force_beyond_the_load_cell_is_counted_and_reaches_neither_hand_nor_predictor(
    rig: MasterRig,
) -> None:
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


def test_a_state_of_another_holder_is_no_state_of_ours(rig: MasterRig) -> None:
    rig.step(5)
    rig.clock.set_ns(rig.now_ns + MS)
    rig.say_state(S.ARMED, session_id=999)
    rig.step(1, state=None)
    assert rig.shown() is None


def test_what_is_published_is_what_the_handle_applied(rig: MasterRig) -> None:
    rig.compare_clocks()
    rig.predictor.answer, rig.force_n = 3.5, 3.0
    rig.push(400)
    assert rig.handle.felt_n[-1] == 2.0
    assert rig.haptics[-1].rendered_n == 2.0
    assert rig.haptics[-1].predicted_n == 3.5


def test_command_and_haptics_of_a_tick_carry_the_same_sequence(rig: MasterRig) -> None:
    rig.step(10)
    assert [m.sequence for m in rig.commands] == [m.sequence for m in rig.haptics] == list(range(1, 11))
    assert rig.haptics[-1].answered_sequence == 9
    assert rig.haptics[-1].delay_s == pytest.approx(0.001)


def test_when_it_is_stopped_the_deadman_opens_at_once_and_the_force_fades_without_a_jump(
    rig: MasterRig,
) -> None:
    rig.compare_clocks()
    rig.push(400)
    assert rig.handle.felt_n[-1] == 1.0
    rig.axis.stopping = True
    before = len(rig.handle.felt_n) - 1
    rig.step(201)
    assert not any(command.deadman for command in rig.commands[-201:])
    steps = [abs(b - a) for a, b in pairwise(rig.handle.felt_n[before:])]
    assert max(steps) <= 0.08 + 1e-12
    assert rig.handle.felt_n[-1] == 0.0
    rig.axis.serve(rig.now_ns + 10_000 * MS)
    assert len(rig.messages(MASTER_HANDSHAKE)) == 1


def test_at_a_fault_the_force_is_gone_at_once_and_stays_away(rig: MasterRig) -> None:
    rig.compare_clocks()
    rig.push(400)
    assert rig.handle.felt_n[-1] == 1.0
    rig.axis.fail(ValueError("torn cable"))
    assert rig.handle.felt_n[-1] == 0.0
    rig.step(50)
    assert set(rig.handle.felt_n[-50:]) == {0.0}
    assert not rig.commands[-1].deadman
    assert rig.reported().counters["fault_ValueError"] == 1


def break_handle(rig: MasterRig) -> None:
    rig.push(400)
    assert rig.commands[-1].deadman
    rig.handle.reading = HandleReading(0.012, 0.05, True)
    rig.step(1)
    rig.handle.broken = {"read", "render"}


def test_a_handle_that_fails_is_let_go_in_the_same_tick_and_the_slave_hears_of_it(rig: MasterRig) -> None:
    break_handle(rig)
    at_m = rig.commands[-1].position_m
    rig.step(50)
    for command, haptics in zip(rig.commands[-50:], rig.haptics[-50:], strict=True):
        assert (command.deadman, command.velocity_m_s, haptics.rendered_n) == (False, 0.0, 0.0)
        assert haptics.handle_position_m == 0.012
    assert abs(rig.commands[-1].position_m - 0.05) < abs(at_m - 0.05) + 1e-12  # follows the stage
    state = rig.reported()
    assert (state.indication, state.reason, state.deadman) == ("handle_fault", "handle: read refused", False)
    assert state.counters["handle_frames_lost"] == 3
    assert rig.axis.events.notices.drain() == [
        "handle: read refused; let the deadman go and press it again to go on"
    ]


def test_a_re_arming_that_fails_leaves_the_handle_let_go(rig: MasterRig) -> None:
    break_handle(rig)
    rig.step(10)

    rig.handle.rearm = refusing(DeviceError("the link is closed"))  # type: ignore[method-assign]
    rig.handle.pressed_anew, rig.handle.broken = True, set()
    rig.step(10)
    assert not rig.commands[-1].deadman
    assert rig.reported().reason == "handle: read refused"


SECOND_NS = 1000 * MS


def requests(request: StopRequest, start_ns: int, end_ns: int) -> int:
    return sum(request.due(now_ns, None, 0) for now_ns in range(start_ns, end_ns, MS))


def test_it_is_said_every_20_ms_for_2_s_then_seldom_and_never_given_up() -> None:
    request = StopRequest()
    assert requests(request, 0, 100 * MS) == 0
    assert request.ask("why", 1 * SECOND_NS)
    assert requests(request, 1 * SECOND_NS, 3 * SECOND_NS) == 100
    assert requests(request, 3 * SECOND_NS + MS, 13 * SECOND_NS) == 40
    assert request.wanted


def test_it_ends_with_a_state_that_was_heard_after_it_and_not_with_an_older_one() -> None:
    request = StopRequest()
    request.ask("first", 1 * SECOND_NS)
    assert not request.ask("second", 1 * SECOND_NS + MS)
    assert request.reason == "first"
    assert request.due(1 * SECOND_NS, usual(SLAVE_STATE, state="estopped"), 1 * SECOND_NS - MS)
    assert request.due(1 * SECOND_NS + 20 * MS, usual(SLAVE_STATE, state="fault"), 1 * SECOND_NS + 10 * MS)
    assert request.due(
        1 * SECOND_NS + 40 * MS,
        usual(SLAVE_STATE, state="estopped", latch_persisted=False),
        1 * SECOND_NS + 30 * MS,
    )
    assert not request.due(
        1 * SECOND_NS + 60 * MS, usual(SLAVE_STATE, state="estopped"), 1 * SECOND_NS + 50 * MS
    )
    assert not request.wanted
    assert request.ask("again", 2 * SECOND_NS)


def test_the_handle_s_button_stops_and_lets_the_deadman_go_as_long_as_it_is_held(
    rig: MasterRig,
) -> None:
    rig.handle.reading = rig.handle.reading._replace(deadman=True)
    rig.step(5)
    assert [command.deadman for command in rig.commands[-3:]] == [True] * 3
    rig.handle.reading = rig.handle.reading._replace(estop=True)
    rig.step(1)
    assert [command.deadman for command in rig.commands[-1:]] == [False]
    assert [stop.reason for stop in rig.messages(EMERGENCY_STOP)] == ["the handle's button"]
    for _ in range(100):
        rig.step(1)
        rig.axis.send_stop(rig.now_ns)
    assert len(rig.messages(EMERGENCY_STOP)) >= 5
    assert not any(command.deadman for command in rig.commands[-100:])


@pytest.mark.parametrize("state", list(S))
def test_slave_in_fault_or_stopped_keeps_the_session_out_of_the_prior(rig: MasterRig, state: S) -> None:
    rig.step(5, state=state)
    rig.step(5)
    assert rig.axis.faulted is (state in {S.FAULT, S.ESTOPPED})


def test_failing_handle_keeps_the_session_out_of_the_prior(rig: MasterRig) -> None:
    rig.handle.broken = {"read", "render"}
    rig.step()
    rig.axis.serve(rig.now_ns)
    assert rig.axis.faulted


def test_no_number_and_no_name_of_the_slave_keeps_a_report_from_being_sent(rig: MasterRig) -> None:
    rules = ["force", "force", "r" * 64, *(f"rule_{n}" for n in range(300))]
    for sequence, rule in enumerate(rules):
        rig.axis.events._on_limit(
            usual(LIMIT_EVENT, sequence=sequence, rule=rule, count=MOST_COUNT), rig.now_ns
        )
    counters = rig.reported().counters
    assert counters["limit_force"] == counters["limit_other"] == MOST_COUNT
    assert len(counters) < 100


def test_what_the_slave_does_without_is_said_once(rig: MasterRig) -> None:
    rig.axis.events.notices.drain()
    for caveats in ((), ("unsafe: gate.lease_s = 5",), ("unsafe: gate.lease_s = 5",)):
        rig.clock.set_ns(rig.now_ns + MS)
        rig.tell(SLAVE_STATE, caveats=caveats)
    assert rig.axis.events.notices.drain() == ["slave: unsafe: gate.lease_s = 5"]
