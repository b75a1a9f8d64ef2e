"""What a master axis does with the hand: command, force, faults, re-arming."""

from itertools import pairwise

import pytest

from forefeel.common.errors import DeviceError
from forefeel.master.handle import HandleReading
from tests.unit.master_rig import MS, Rig, linked

rig = pytest.fixture(linked, name="rig")


def test_what_is_published_is_what_the_handle_applied(rig: Rig) -> None:
    rig.compare_clocks()
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


def test_a_handle_that_answers_again_stays_let_go_until_the_deadman_is_pressed_anew(rig: Rig) -> None:
    rig.compare_clocks()
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
