from hypothesis import given
from hypothesis import strategies as st

from forefeel.master.handle import HandleReading
from forefeel.master.haptics import Clutch

METRE = st.floats(-1.0, 1.0)


def reading(position_m: float, deadman: bool) -> HandleReading:
    return HandleReading(position_m, 0.0, deadman)


def test_with_the_clutch_open_the_command_stays_on_the_stage() -> None:
    clutch = Clutch()
    for handle_m, stage_m in ((0.0, 0.05), (0.3, 0.05), (-0.2, 0.06)):
        assert abs(clutch.command_m(reading(handle_m, False), stage_m) - stage_m) < 1e-15


def test_engaging_does_not_jump_and_then_the_command_moves_as_the_handle() -> None:
    clutch = Clutch()
    clutch.command_m(reading(0.1, False), 0.03)
    assert abs(clutch.command_m(reading(0.1, True), 0.03) - 0.03) < 1e-15
    assert abs(clutch.command_m(reading(0.102, True), 0.5) - 0.032) < 1e-15
    assert abs(clutch.command_m(reading(0.09, True), None) - 0.02) < 1e-15


def test_before_any_readback_the_handle_is_the_command() -> None:
    assert Clutch().command_m(reading(0.02, False), None) == 0.02
    assert Clutch().command_m(reading(0.02, True), None) == 0.02


def test_a_readback_that_is_lost_keeps_the_last_offset() -> None:
    clutch = Clutch()
    clutch.command_m(reading(0.0, False), 0.04)
    assert clutch.command_m(reading(0.01, False), None) == 0.05


@given(st.lists(st.tuples(METRE, st.booleans(), st.one_of(st.none(), METRE)), min_size=1, max_size=50))
def test_while_the_clutch_is_closed_the_command_moves_exactly_with_the_handle(
    steps: list[tuple[float, bool, float | None]],
) -> None:
    clutch, before = Clutch(), None
    for handle_m, closed, stage_m in steps:
        command_m = clutch.command_m(reading(handle_m, closed), stage_m)
        if closed and before is not None:
            assert abs((command_m - before[0]) - (handle_m - before[1])) < 1e-12
        if not closed and stage_m is not None:
            assert abs(command_m - stage_m) < 1e-12
        before = command_m, handle_m
