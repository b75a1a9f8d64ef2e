"""Slots and queues between threads, in one thread."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.slots import BoundedQueue, CommandRing, LatestValue
from forefeel.common.topics import COMMAND
from forefeel.slave.command_receiver import CommandSlot
from tests.messages import usual


def test_a_slot_keeps_the_newest_and_gives_it_once() -> None:
    slot: LatestValue[int] = LatestValue()
    assert slot.take() is None
    for value in (1, 2, 3):
        slot.put(value)
    assert (slot.take(), slot.take()) == (3, None)


@given(st.integers(1, 8), st.lists(st.one_of(st.integers(), st.none()), max_size=60))
def test_queue_keeps_the_newest_in_order_and_counts_drops(capacity: int, steps: list[int | None]) -> None:
    queue: BoundedQueue[int] = BoundedQueue(capacity)
    expected, dropped = list[int](), 0
    for step in steps:
        if step is None:
            assert queue.drain() == expected
            expected = []
        else:
            queue.put(step)
            expected.append(step)
            dropped += len(expected) > capacity
            expected = expected[-capacity:]
    assert (queue.drain(), queue.drain(), queue.dropped) == (expected, [], dropped)


@pytest.mark.parametrize(
    ("deadmen", "released"),
    [([True], False), ([False], True), ([False, True], True), ([True, False, True, True], True)],
)
def test_newest_command_is_taken_once_with_any_release_before(deadmen: list[bool], released: bool) -> None:
    slot, newest = CommandSlot(), len(deadmen) - 1
    commands = [usual(COMMAND, sequence=n, deadman=deadman) for n, deadman in enumerate(deadmen)]
    for number, command in enumerate(commands):
        slot.put(command, 100 + number)
    assert slot.take() == ((commands[-1], 100 + newest), released)
    assert slot.take() == (None, False)
    assert slot.superseded == newest


@given(st.sets(st.integers(0, 200), min_size=1), st.integers(0, 200), st.integers(0, 10**9))
def test_a_ring_gives_the_last_command_before_a_motion(sent_ms: set[int], at_ms: int, start_ms: int) -> None:
    ring = CommandRing[int]()
    for sent in sorted(sent_ms):
        ring.put((start_ms + sent) * 1_000_000, sent)
    before = [sent for sent in sent_ms if at_ms - 5 < sent <= at_ms]
    assert ring.get((start_ms + at_ms) * 1_000_000) == max(before, default=None)
    between = [sent for sent in sent_ms if at_ms - 4 <= sent <= at_ms]
    assert ring.get((start_ms + at_ms) * 1_000_000 + 999_999) == max(between, default=None)
