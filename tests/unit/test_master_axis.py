"""Sessions of a master axis, and what it makes of forces and states that arrive."""

import pytest

from forefeel.common.messages import (
    MOST_FORCE_N,
    SlaveState,
)
from forefeel.common.settings import AxisLimits, settings_hash, shared_text
from forefeel.master.session import SessionState
from tests.unit.master_rig import FULL_SCALE_N, MS, SHARED, Rig, S, linked, shown

rig = pytest.fixture(linked, name="rig")


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
    assert rig.axis.session.state is SessionState.MISMATCH
    assert rig.axis.session.cause(rig.now_ns) == "settings differ: max_force_n: 3.0 here, 30.0 there"
    rig.clock.set_ns(rig.now_ns + 5000 * MS)
    rig.axis.serve(rig.now_ns)
    assert len(rig.asked) == 1
    rig.step(5)
    assert rig.commands == []


def test_a_session_that_the_slave_lost_is_replaced_and_nothing_of_it_is_felt(rig: Rig) -> None:
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
    assert rig.handle.shown.state is None


# --- forces and states ---


def test_forces_of_another_session_are_counted_and_not_used(rig: Rig) -> None:
    for session_id in (0, 5, 5):
        rig.say_force(session_id, position_m=0.9)
    rig.step(1, state=S.ARMED, force=False)
    assert rig.haptics[-1].zoh_n is None
    assert rig.handle.shown.stage_position_m is None
    assert rig.counters()["forces_of_another_session"] == 2


def test_a_force_beyond_the_load_cell_is_counted_and_reaches_neither_hand_nor_predictor(rig: Rig) -> None:
    rig.step(1)
    for force_n in (FULL_SCALE_N, 1.001 * FULL_SCALE_N, -MOST_FORCE_N):
        rig.clock.set_ns(rig.now_ns + MS)
        rig.say_force(force_n=force_n)
    rig.step(1, force=False)
    assert rig.haptics[-1].zoh_n == FULL_SCALE_N
    assert rig.counters()["forces_out_of_range"] == 2
    assert [sample.force_n for sample in rig.axis.identification.queue.drain()] == [0.3, FULL_SCALE_N]


def test_a_force_that_was_overtaken_is_learned_from_but_not_shown(rig: Rig) -> None:
    rig.step(1)
    rig.say_force(force_n=0.8, position_m=0.06, stamp_ns=500)
    rig.say_force(force_n=0.9, position_m=0.07, stamp_ns=499)
    rig.step(1, force=False)
    assert rig.haptics[-1].zoh_n == 0.3
    assert rig.counters()["forces_reordered"] == 2
    assert len(rig.axis.identification.queue.drain()) == 3


def test_the_state_is_shown_until_half_a_second_after_the_last_word(rig: Rig) -> None:
    rig.step(1)
    rig.step(500, state=None)
    assert shown(rig) is S.ARMED
    rig.step(1, state=None)
    assert shown(rig) is None
    rig.axis.report(rig.now_ns)
    assert rig.states[-1].indication == "no_session"


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
