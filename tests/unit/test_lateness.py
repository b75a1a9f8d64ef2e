from bisect import bisect_left
from math import inf

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.lateness import EDGES_US, Lateness

LATE_NS = st.lists(st.integers(0, 900_000_000), min_size=1, max_size=300)
SHARES = (0.01, 0.5, 0.9, 0.99, 1.0)


def recorded(late_ns: list[int]) -> Lateness:
    lateness = Lateness()
    for late in late_ns:
        lateness.record(late)
    return lateness


def bin_of(value_us: float) -> tuple[float, float]:
    index = bisect_left(EDGES_US, value_us)
    return (EDGES_US[index - 1] if index else 0.0), (EDGES_US[index] if index < len(EDGES_US) else inf)


@given(LATE_NS)
def test_a_quantile_lies_in_the_bin_of_the_true_one_and_rises_to_the_maximum(late_ns: list[int]) -> None:
    lateness = recorded(late_ns)
    assert (lateness.ticks, sum(lateness.counts)) == (len(late_ns), len(late_ns))
    for share in SHARES:
        true_us = float(np.quantile(late_ns, share, method="inverted_cdf")) * 1e-3
        low, high = bin_of(true_us)
        assert low <= lateness.quantile_us(share) <= high * (1 + 1e-12)
    values = [lateness.quantile_us(share / 20) for share in range(21)]
    assert values == sorted(values)
    assert values[-1] <= lateness.max_us == max(late_ns) * 1e-3
