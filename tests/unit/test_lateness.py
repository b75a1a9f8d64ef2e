from bisect import bisect_left
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.lateness import EDGES_US, Lateness, quantile_us

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


def test_the_edges_are_eight_to_a_decade_from_a_microsecond_to_a_second() -> None:
    assert (EDGES_US[0], EDGES_US[-1], len(EDGES_US)) == (1.0, 1e6, 49)
    np.testing.assert_allclose(np.diff(np.log10(EDGES_US)), 1 / 8, rtol=2e-3)


def test_nothing_recorded_is_no_lateness() -> None:
    lateness = Lateness()
    assert (lateness.ticks, lateness.max_us, lateness.quantile_us(0.5), lateness.quantile_us(1.0)) == (
        0,
        0,
        0,
        0,
    )


@given(LATE_NS)
def test_a_quantile_lies_in_the_bin_of_the_true_one(late_ns: list[int]) -> None:
    lateness = recorded(late_ns)
    assert (lateness.ticks, sum(lateness.counts)) == (len(late_ns), len(late_ns))
    for share in SHARES:
        true_us = float(np.quantile(late_ns, share, method="inverted_cdf")) * 1e-3
        low, high = bin_of(true_us)
        assert low <= lateness.quantile_us(share) <= high * (1 + 1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_quantiles_of_many_ticks_against_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    late_ns = rng.lognormal(11.0, 1.3, 20_000).astype(np.int64)
    lateness = recorded(late_ns.tolist())
    for share in (0.5, 0.9, 0.99, 0.999):
        ratio = lateness.quantile_us(share) / (np.quantile(late_ns, share) * 1e-3)
        assert 10 ** (-1 / 8) < ratio < 10 ** (1 / 8)
    assert lateness.max_us == pytest.approx(late_ns.max() * 1e-3)


@given(LATE_NS)
def test_quantiles_rise_with_the_share_and_stay_below_the_maximum(late_ns: list[int]) -> None:
    lateness = recorded(late_ns)
    values = [lateness.quantile_us(share / 20) for share in range(21)]
    assert values == sorted(values)
    assert values[-1] <= lateness.max_us == max(late_ns) * 1e-3


def test_later_than_a_second_is_counted_in_the_last_bin() -> None:
    lateness = recorded([5_000_000_000] * 3)
    assert lateness.counts[-1] == 3
    assert lateness.quantile_us(0.5) == EDGES_US[-1]
    assert lateness.max_us == 5e6


def test_linear_inside_a_bin() -> None:
    counts = [0] * (len(EDGES_US) + 1)
    counts[0] = 4
    assert [quantile_us(counts, share) for share in (0.25, 0.5, 1.0)] == [0.25, 0.5, 1.0]


def test_on_time_is_the_same_as_zero_late() -> None:
    one, other = Lateness(), recorded([0, 0])
    one.record_on_time()
    one.record_on_time()
    assert vars(one) == vars(other)
