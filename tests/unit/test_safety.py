from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import FOLLOWING, SafetyState
from forefeel.slave.safety import TABLE, SafetyEventName, SafetyMachine

# Written from the safety concept, not from the code: one row a state, in it every event that leaves it.
EXPECTED = {
    "idle": "session_opened ready, fault fault, estop estopped",
    "ready": "session_lost idle, engage engaging, fault fault, estop estopped",
    "engaging": (
        "engaged armed, release stopping, watchdog stopping, session_lost stopping, misaligned stopping,"
        " round_trip stopping, shutdown stopping, fault fault, estop estopped"
    ),
    "armed": (
        "release stopping, watchdog stopping, session_lost stopping, misaligned stopping,"
        " round_trip stopping, shutdown stopping, fault fault, estop estopped"
    ),
    "stopping": "at_rest ready, fault fault, estop estopped",
    "fault": "clear idle, estop estopped",
    "estopped": "clear idle",
}


def expected(state: SafetyState, event: SafetyEventName) -> SafetyState:
    leaves = dict(entry.split() for entry in EXPECTED[state.value].split(","))
    return SafetyState(leaves.get(event.value, state.value))


def machine_in(state: SafetyState) -> SafetyMachine:
    machine = SafetyMachine()
    machine.state = state
    return machine


def test_the_expectation_names_every_state_and_only_known_events() -> None:
    assert set(EXPECTED) == {state.value for state in SafetyState}
    named = {entry.split()[0] for row in EXPECTED.values() for entry in row.split(",")}
    assert named == {event.value for event in SafetyEventName}


@pytest.mark.parametrize(("state", "event"), list(product(SafetyState, SafetyEventName)))
def test_every_state_and_event(state: SafetyState, event: SafetyEventName) -> None:
    machine = machine_in(state)
    changed = machine.fire(event, "why")
    after = expected(state, event)
    assert machine.state is after
    assert changed == (None if after is state else (state, after))
    assert machine.reason == ("started" if after is state else "why")


def test_only_engaging_and_armed_follow() -> None:
    following = {state for state in SafetyState if machine_in(state).following}
    assert following == FOLLOWING == {SafetyState.ENGAGING, SafetyState.ARMED}


def test_a_machine_starts_at_rest() -> None:
    machine = SafetyMachine()
    assert (machine.state, machine.following) == (SafetyState.IDLE, False)


EVENTS = st.lists(st.sampled_from(SafetyEventName), max_size=60)


def run(events: list[SafetyEventName]) -> SafetyMachine:
    machine = SafetyMachine()
    for event in events:
        machine.fire(event, event.value)
    return machine


@given(EVENTS, EVENTS)
def test_a_stop_is_latched_until_it_is_cleared(
    before: list[SafetyEventName], after: list[SafetyEventName]
) -> None:
    machine = run(before)
    machine.fire(SafetyEventName.ESTOP, "stop")
    for event in after:
        if event is not SafetyEventName.CLEAR:
            machine.fire(event, "later")
    assert machine.fire(SafetyEventName.ESTOP, "again") is None
    assert machine.fire(SafetyEventName.CLEAR, "cleared") == (SafetyState.ESTOPPED, SafetyState.IDLE)


@given(EVENTS, EVENTS)
def test_a_fault_moves_again_only_after_a_clear_a_session_and_an_engagement(
    before: list[SafetyEventName], after: list[SafetyEventName]
) -> None:
    machine = run(before)
    machine.fire(SafetyEventName.FAULT, "fault")
    path = [SafetyEventName.CLEAR, SafetyEventName.SESSION_OPENED, SafetyEventName.ENGAGE]
    for event in after:
        if path and event is path[0] and machine.state is not expected(machine.state, event):
            path.pop(0)
        machine.fire(event, "later")
        if machine.following:
            assert not path


def test_nothing_leads_to_motion_but_an_engagement_from_ready() -> None:
    into = {key for key, after in TABLE.items() if after in FOLLOWING and key[0] not in FOLLOWING}
    assert into == {(SafetyState.READY, SafetyEventName.ENGAGE)}
