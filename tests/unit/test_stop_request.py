"""An emergency stop at the master: said until the slave shows it, and the deadman is let go meanwhile."""

from forefeel.common.messages import Grip, SafetyState, SlaveState
from forefeel.master.stop import StopRequest
from tests.unit.master_rig import Rig

MS = 1_000_000
S = 1000 * MS


def said(request: StopRequest, start_ns: int, end_ns: int) -> int:
    return sum(request.due(now_ns, None, 0) for now_ns in range(start_ns, end_ns, MS))


def slave_says(state: SafetyState, persisted: bool = True) -> SlaveState:
    return SlaveState(
        session_id=0, sequence=1, stamp_ns=0, state=state, reason="", latch_persisted=persisted,
        position_m=0.0, velocity_m_s=0.0, gripper=Grip.CLOSED, stops=0,
        clock_offset_ns=None, clock_bound_ns=None, counters={},
    )  # fmt: skip


def test_it_is_said_every_20_ms_for_2_s_then_seldom_and_never_given_up() -> None:
    request = StopRequest()
    assert said(request, 0, 100 * MS) == 0
    assert request.ask("why", 1 * S)
    assert said(request, 1 * S, 3 * S) == 100
    assert said(request, 3 * S + MS, 13 * S) == 40
    assert request.wanted


def test_it_ends_with_a_state_that_was_heard_after_it_and_not_with_an_older_one() -> None:
    request = StopRequest()
    request.ask("first", 1 * S)
    assert not request.ask("second", 1 * S + MS)
    assert request.reason == "first"
    assert request.due(1 * S, slave_says(SafetyState.ESTOPPED), 1 * S - MS)
    assert request.due(1 * S + 20 * MS, slave_says(SafetyState.FAULT), 1 * S + 10 * MS)
    assert request.due(1 * S + 40 * MS, slave_says(SafetyState.ESTOPPED, persisted=False), 1 * S + 30 * MS)
    assert not request.due(1 * S + 60 * MS, slave_says(SafetyState.ESTOPPED), 1 * S + 50 * MS)
    assert not request.wanted
    assert request.ask("again", 2 * S)


def test_the_handle_s_button_stops_and_lets_the_deadman_go_as_long_as_it_is_held() -> None:
    rig = Rig()
    rig.axis.serve(rig.now_ns)
    rig.answer()
    rig.handle.reading = rig.handle.reading._replace(deadman=True)
    rig.step(5)
    assert [command.deadman for command in rig.commands[-3:]] == [True] * 3
    rig.handle.reading = rig.handle.reading._replace(estop=True)
    rig.step(1)
    assert [command.deadman for command in rig.commands[-1:]] == [False]
    assert [stop.reason for stop in rig.stops] == ["the handle's button"]
    for _ in range(100):
        rig.step(1)
        rig.axis.say_stop(rig.now_ns)
    assert len(rig.stops) >= 5
    assert not any(command.deadman for command in rig.commands[-100:])
