import pytest

from forefeel.common.messages import MotionCommand
from forefeel.slave.command_receiver import CommandSlot


def command(sequence: int, deadman: bool) -> MotionCommand:
    return MotionCommand(
        session_id=1, sequence=sequence, stamp_ns=sequence, position_m=0.0, velocity_m_s=0.0, deadman=deadman
    )


def test_an_empty_slot_gives_nothing() -> None:
    assert CommandSlot().take() == (None, False)


@pytest.mark.parametrize(
    ("deadmen", "released"),
    [([True], False), ([False], True), ([False, True], True), ([True, False, True, True], True)],
)
def test_the_newest_command_is_taken_once_with_any_release_before_it(
    deadmen: list[bool], released: bool
) -> None:
    slot = CommandSlot()
    for sequence, deadman in enumerate(deadmen):
        slot.put(command(sequence, deadman), 100 + sequence)
    newest = len(deadmen) - 1
    assert slot.take() == ((command(newest, deadmen[-1]), 100 + newest), released)
    assert slot.take() == (None, False)
    assert slot.superseded == newest


def test_a_release_is_told_once() -> None:
    slot = CommandSlot()
    slot.put(command(1, False), 1)
    slot.put(command(2, True), 2)
    slot.take()
    slot.put(command(3, True), 3)
    assert slot.take().released is False
