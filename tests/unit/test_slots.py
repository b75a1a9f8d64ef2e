import threading

from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.slots import BoundedQueue, LatestValue


def test_a_slot_keeps_the_newest_and_gives_it_once() -> None:
    slot: LatestValue[int] = LatestValue()
    assert slot.take() is None
    slot.put(1)
    slot.put(2)
    slot.put(3)
    assert (slot.take(), slot.take(), slot.superseded) == (3, None, 2)


def test_a_value_that_counts_as_false_is_a_value() -> None:
    slot: LatestValue[int] = LatestValue()
    slot.put(0)
    slot.put(0)
    assert (slot.take(), slot.superseded) == (0, 1)


def test_what_two_threads_pass_through_a_slot_is_taken_or_counted_and_never_goes_back() -> None:
    slot: LatestValue[int] = LatestValue()
    last, taken = 20_000, list[int]()

    def produce() -> None:
        for value in range(1, last + 1):
            slot.put(value)

    producer = threading.Thread(target=produce)
    producer.start()
    while producer.is_alive():
        if (value := slot.take()) is not None:
            taken.append(value)
    if (value := slot.take()) is not None:
        taken.append(value)
    assert taken == sorted(set(taken))
    assert taken[-1] == last
    assert len(taken) + slot.superseded == last


@given(st.integers(1, 8), st.lists(st.one_of(st.integers(), st.none()), max_size=60))
def test_a_queue_keeps_the_newest_in_order_and_counts_what_it_drops(
    capacity: int, steps: list[int | None]
) -> None:
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


def test_draining_while_another_thread_puts_loses_nothing_uncounted() -> None:
    queue: BoundedQueue[int] = BoundedQueue(1_000_000)
    last, got = 20_000, list[int]()

    def produce() -> None:
        for value in range(last):
            queue.put(value)

    producer = threading.Thread(target=produce)
    producer.start()
    while producer.is_alive():
        got += queue.drain()
    got += queue.drain()
    assert (got, queue.dropped) == (list(range(last)), 0)
