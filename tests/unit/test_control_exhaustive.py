"""Every safety state, reached as it is in service, with every event: state and motion after it."""

from itertools import product
from typing import Any

import pytest

from forefeel.common.messages import SafetyState
from forefeel.slave.safety import SafetyEventName
from tests.clocks import compared
from tests.unit.test_control import MS, START_M, Rig
from tests.unit.test_safety import expected as table_says

S, E = SafetyState, SafetyEventName
STOP_M_S2, SPEED_M_S = 4.0, 0.1
LONGEST_M = SPEED_M_S**2 / (2 * STOP_M_S2) + 2e-4  # of the ramp to rest, and a tick


def reached(state: SafetyState) -> Rig:
    """The loop in that state, moving where it can move."""
    rig = Rig()
    match state:
        case S.IDLE:
            rig.session_live = False
            rig.tick()
        case S.READY:
            rig.released(3)
        case S.ENGAGING:
            rig.engaged()
            for i in range(100):
                rig.held(1, START_M + 2e-5 * i, velocity_m_s=0.02)
        case S.ARMED:
            rig.moving(SPEED_M_S)
        case S.STOPPING:
            rig.moving(SPEED_M_S).released()
        case S.FAULT:
            rig.moving(SPEED_M_S).tick(fault="stage: gone")
        case S.ESTOPPED:
            rig.moving(SPEED_M_S).tick(estop="button")
    assert rig.state() is state
    return rig


INPUTS: dict[SafetyEventName, dict[str, Any]] = {
    E.SESSION_OPENED: {"session_live": True},
    E.SESSION_LOST: {"session_live": False},
    E.ROUND_TRIP: {"clock": compared(0, 351 * MS)},
    E.AT_REST: {},
    E.SHUTDOWN: {"shutdown": True},
    E.FAULT: {"fault": "thread: died"},
    E.ESTOP: {"estop": "nurse"},
    E.CLEAR: {"clear": True},
}


def inject(rig: Rig, event: SafetyEventName) -> None:
    """One event as the loop sees it, all else as it was."""
    state, held_m = rig.state(), rig.out.target_m
    pressed = state in (S.ENGAGING, S.ARMED)
    match event:
        case E.ENGAGE:
            rig.released()
            if not pressed:  # there a release is the event of another test
                rig.held()
        case E.ENGAGED:
            for _ in range(250 if state is S.ENGAGING else 1):
                rig.tick(rig.command(held_m, pressed))
        case E.RELEASE:
            rig.tick(rig.command(held_m, False))
        case E.WATCHDOG:
            rig.tick()
        case E.MISALIGNED:
            rig.tick(rig.command(held_m + 0.03, pressed))
        case _:
            rig.tick(rig.command(held_m, pressed), **INPUTS[event])


def expected(state: SafetyState, event: SafetyEventName) -> SafetyState:
    """The machine's table, but for two events that the loop does not raise: an armed stage follows whatever
    is asked within its limits, and nothing is at rest that moves.
    """
    raised = (state, event) not in {(S.ARMED, E.MISALIGNED), (S.STOPPING, E.AT_REST)}
    return table_says(state, event) if raised else state


PRESSED = {(S.ENGAGING, E.ENGAGE), (S.ARMED, E.ENGAGE)}  # a press while pressed is no event at all
CASES = [case for case in product(S, E) if case not in PRESSED]


@pytest.mark.parametrize(("state", "event"), CASES)
def test_every_state_with_every_event(state: SafetyState, event: SafetyEventName) -> None:
    """Motion while it follows is within the limits. Else the speed only falls, by the ramp, to rest."""
    rig = reached(state)
    for _ in range(60 if event is E.WATCHDOG else 0):  # without a command, in which the stage goes on
        rig.tick()
    assert rig.state() is state or (state is S.STOPPING and event is E.WATCHDOG)  # which has come to rest
    state = rig.state()
    before_m, before_m_s = rig.out.target_m, rig.out.velocity_m_s
    inject(rig, event)
    after = expected(state, event)
    if event is E.CLEAR and state in (S.FAULT, S.ESTOPPED):
        after = S.READY  # the session lives: it is opened in the tick of the clearing
    assert rig.state() is after
    if rig.control.machine.following:
        assert rig.out.moving
        assert rig.out.executing is not None
        assert abs(rig.out.velocity_m_s) <= 0.2 + 1e-12
        return
    assert rig.out.executing is None
    assert abs(rig.out.velocity_m_s) <= max(0.0, abs(before_m_s) - STOP_M_S2 * 1e-3) + 1e-12
    assert abs(rig.out.target_m - before_m) <= LONGEST_M
    rested_m = rig.at_rest_m()
    assert abs(rested_m - before_m) <= LONGEST_M
    for _ in range(100):  # what is asked without a press moves nothing
        rig.tick(rig.command(rested_m + 5e-4, False))
        assert (rig.out.moving, rig.out.target_m, rig.out.velocity_m_s) == (False, rested_m, 0.0)


@pytest.mark.parametrize("halt", [S.FAULT, S.ESTOPPED])
@pytest.mark.parametrize("event", [e for e in E if e not in (E.CLEAR,)])
def test_of_a_halt_nothing_but_a_clearing_leads_back(halt: SafetyState, event: SafetyEventName) -> None:
    rig = reached(halt)
    inject(rig, event)
    rig.at_rest_m()
    rig.released(5)
    rig.held(300)
    assert rig.state() in (S.FAULT, S.ESTOPPED)
    assert not rig.out.moving
    rig.tick(clear=True)
    rig.held(50)
    assert not rig.out.moving, "a clearing is no press"
    rig.released(3)
    rig.held(250)
    assert rig.state() is S.ARMED
