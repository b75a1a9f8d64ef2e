from itertools import product

import pytest

from forefeel.common.messages import FOLLOWING, SafetyState
from forefeel.slave.safety import SafetyEventName, SafetyMachine

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


def test_the_expectation_names_every_state_and_only_known_events() -> None:
    assert set(EXPECTED) == {state.value for state in SafetyState}
    named = {entry.split()[0] for row in EXPECTED.values() for entry in row.split(",")}
    assert named == {event.value for event in SafetyEventName}


def expected(state: SafetyState, event: SafetyEventName) -> SafetyState:
    leaves = dict(entry.split() for entry in EXPECTED[state.value].split(","))
    return SafetyState(leaves.get(event.value, state.value))


@pytest.mark.parametrize(("state", "event"), list(product(SafetyState, SafetyEventName)))
def test_every_state_and_event(state: SafetyState, event: SafetyEventName) -> None:
    machine = SafetyMachine()
    assert (machine.state, machine.following) == (SafetyState.IDLE, False)
    machine.state = state
    changed = machine.fire(event, "why")
    after = expected(state, event)
    assert machine.state is after
    assert changed == (None if after is state else (state, after))
    assert machine.reason == ("started" if after is state else "why")
    assert machine.following == (after in FOLLOWING) == (after.value in {"engaging", "armed"})
