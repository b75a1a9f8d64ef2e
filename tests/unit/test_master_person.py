import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import SafetyState
from forefeel.devices.simulated.operator import REACTION_S, Act, SimulatedOperatorPolicy

S = SafetyState
STATES = (None, *SafetyState)


def looked(person: SimulatedOperatorPolicy, now_s: float, state: SafetyState | None) -> Act:
    person.look(now_s, state)
    return person.act


def armed(now_s: float = 10.0) -> SimulatedOperatorPolicy:
    person = SimulatedOperatorPolicy()
    assert looked(person, now_s, S.READY) is Act.PRESSING
    assert looked(person, now_s + 0.3, S.ARMED) is Act.MOVING
    return person


@pytest.mark.parametrize("state", [state for state in STATES if state is not S.READY])
def test_nothing_but_ready_makes_a_person_press(state: SafetyState | None) -> None:
    person = SimulatedOperatorPolicy()
    for i in range(100):
        assert looked(person, 10.0 + i, state) is Act.WAITING
        assert not person.pressed


def test_ready_is_answered_by_a_press_and_armed_by_a_motion() -> None:
    person = armed()
    assert person.pressed
    assert person.stops == 0


def test_armed_by_itself_moves_nobody() -> None:
    assert looked(SimulatedOperatorPolicy(), 10.0, S.ARMED) is Act.WAITING


@pytest.mark.parametrize("state", [state for state in STATES if state is not S.ARMED])
def test_at_a_stop_the_hand_opens_at_once_and_presses_again_half_a_second_later(
    state: SafetyState | None,
) -> None:
    person = armed(10.0)
    assert looked(person, 11.0, state) is Act.WAITING
    assert person.stops == 1
    assert looked(person, 11.0 + REACTION_S - 1e-6, S.READY) is Act.WAITING
    assert looked(person, 11.0 + REACTION_S, S.READY) is Act.PRESSING


def test_who_is_not_armed_within_three_seconds_lets_go_and_tries_again() -> None:
    person = SimulatedOperatorPolicy()
    person.look(10.0, S.READY)
    assert looked(person, 13.0, S.READY) is Act.PRESSING
    assert looked(person, 13.001, S.READY) is Act.WAITING
    assert looked(person, 13.4, S.READY) is Act.WAITING
    assert looked(person, 13.6, S.READY) is Act.PRESSING
    assert person.stops == 0


def test_letting_go_by_choice_is_no_stop_and_its_time_is_counted_until_armed() -> None:
    person = armed(10.0)
    person.look(11.0, S.ARMED)
    person.release(11.0)
    for i in range(1, 13):
        person.look(11.0 + i * 0.1, S.READY)
    assert person.pressed
    person.look(12.4, S.ARMED)
    person.look(12.9, S.ARMED)
    assert person.clutched_out_s == pytest.approx(1.4)
    assert person.stops == 0


def test_time_after_a_stop_is_not_by_choice() -> None:
    person = armed(10.0)
    person.look(11.0, S.STOPPING)
    person.look(12.0, S.READY)
    person.look(12.3, S.ARMED)
    assert person.clutched_out_s == 0.0


@given(st.lists(st.tuples(st.floats(0.001, 1.0), st.sampled_from(STATES)), max_size=80))
def test_a_press_begins_at_ready_only_and_never_sooner_than_the_reaction(
    glances: list[tuple[float, SafetyState | None]],
) -> None:
    person, now_s = SimulatedOperatorPolicy(), 100.0
    released_s = now_s - REACTION_S
    for pause_s, state in glances:
        now_s += pause_s
        was, stops = person.act, person.stops
        act = looked(person, now_s, state)
        if was is Act.WAITING and act is Act.PRESSING:
            assert state is S.READY
            assert now_s - released_s >= REACTION_S - 1e-9
        if act is Act.MOVING:
            assert state is S.ARMED
        if was is not Act.WAITING and act is Act.WAITING:
            released_s = now_s
        assert person.stops - stops == (was is Act.MOVING and act is Act.WAITING)
