"""Order of stamps: lone ones from the future, clocks that are set, networks that are merely bad."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.stamp_order import Order, StampOrder

MS = 1_000_000
S = 1_000_000_000
NEWER = "newer"


@given(
    st.integers(-(2**62), 2**62),
    st.sampled_from([1, 20, 50, 100]),
    st.lists(st.integers(0, 19 * MS), min_size=30, max_size=60),
    st.integers(1, 25),
    st.integers(41 * MS, 2**60),
)
def test_a_lone_stamp_from_the_future_changes_nothing_that_follows(
    offset_ns: int, period_ms: int, jitter_ns: list[int], forged_at: int, ahead_ns: int
) -> None:
    alone, attacked = StampOrder(), StampOrder()
    for n, late_ns in enumerate(jitter_ns):
        stamp_ns, receive_ns = offset_ns + n * period_ms * MS, n * period_ms * MS + late_ns
        if n == forged_at:
            forged = attacked.judge(offset_ns + receive_ns + ahead_ns, receive_ns)
            assert (forged, attacked.step_ns) == ("ahead", 0)
        assert attacked.judge(stamp_ns, receive_ns) == alone.judge(stamp_ns, receive_ns)
        assert alone.step_ns == attacked.step_ns == 0


@pytest.mark.parametrize("period_ms", [1, 20, 50, 100])
@pytest.mark.parametrize("step_ns", [50 * MS, S, -S, 3600 * S, -3600 * S])
@pytest.mark.parametrize("backwards", [True, False])
def test_clock_that_was_set_is_reported_within_300_ms(period_ms: int, step_ns: int, backwards: bool) -> None:
    order, period_ns = StampOrder(backwards), period_ms * MS
    for n in range(100):
        order.judge(n * period_ns, n * period_ns)
    first = next(
        n for n in range(100, 999) if order.judge(n * period_ns + step_ns, n * period_ns) and order.step_ns
    )
    assert order.step_ns == step_ns
    assert (first - 99) * period_ns <= 300 * MS
    goes_on = order.judge((first + 1) * period_ns + step_ns, (first + 1) * period_ns)
    assert goes_on == (NEWER if step_ns > 0 or backwards else "older")


def test_a_slower_way_a_stall_with_its_burst_and_a_faster_way_lose_nothing_for_long() -> None:
    order, places = StampOrder(), list[Order]()
    for n in range(3000):
        arrival_ms = n + (300 if n < 2000 else 100) + (2200 - n if 2100 <= n < 2200 else 0)
        places.append(order.judge(n * MS, arrival_ms * MS))
    assert set(places[:2000]) == set(places[2051:]) == {NEWER}
    assert set(places[2000:2050]) == {"ahead"}
