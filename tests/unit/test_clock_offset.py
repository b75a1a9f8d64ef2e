from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.clock_offset import ClockOffset, OffsetEstimate

MS = 1_000_000
S = 1_000_000_000
PPM = 1e-6


def exchange(
    clock: ClockOffset, sent_ns: int, offset_ns: int, there_ns: int, back_ns: int, peer_ns: int = 0
) -> int:
    """One exchange that starts at `sent_ns`, with the given one-way delays; the stamp of its end."""
    received_ns = sent_ns + there_ns
    end_ns = received_ns + peer_ns + back_ns
    clock.update(sent_ns, received_ns + offset_ns, received_ns + peer_ns + offset_ns, end_ns)
    return end_ns


def best(clock: ClockOffset) -> OffsetEstimate:
    assert clock.best is not None
    return clock.best


def test_nothing_is_known_before_an_exchange() -> None:
    assert ClockOffset().best is None


@pytest.mark.parametrize("offset_ns", [0, 1, -1, 3 * S, -86_400 * S])
def test_equal_delays_give_the_offset_exactly(offset_ns: int) -> None:
    clock = ClockOffset()
    exchange(clock, S, offset_ns, 7 * MS, 7 * MS, peer_ns=40 * MS)
    assert best(clock) == OffsetEstimate(offset_ns, 7 * MS)
    assert best(clock).round_trip_ns == 14 * MS


@pytest.mark.parametrize(("there_ns", "back_ns"), [(20 * MS, 0), (0, 20 * MS), (15 * MS, 5 * MS)])
def test_unequal_delays_shift_the_offset_by_no_more_than_the_bound(there_ns: int, back_ns: int) -> None:
    clock = ClockOffset()
    exchange(clock, S, 5 * S, there_ns, back_ns)
    assert best(clock).bound_ns == 10 * MS
    assert best(clock).offset_ns - 5 * S == (there_ns - back_ns) // 2


def test_the_exchange_with_the_shortest_round_trip_counts() -> None:
    clock = ClockOffset()
    end_ns = exchange(clock, S, 0, 2 * MS, 2 * MS)
    for _ in range(20):
        end_ns = exchange(clock, end_ns, 0, 90 * MS, 10 * MS)
    assert best(clock).offset_ns == 0
    assert 2 * MS <= best(clock).bound_ns <= 2 * MS + 2 * S * 100 * PPM


def test_what_is_older_than_the_window_does_not_count() -> None:
    clock = ClockOffset(window_ns=S)
    end_ns = exchange(clock, S, 0, MS, MS)
    end_ns = exchange(clock, end_ns + S, 100, 30 * MS, 30 * MS)
    assert best(clock) == OffsetEstimate(100, 30 * MS)


def test_the_bound_of_an_exchange_grows_with_its_age() -> None:
    clock = ClockOffset()
    end_ns = exchange(clock, S, 0, MS, MS)
    exchange(clock, end_ns + 5 * S, 0, 50 * MS, 50 * MS)
    assert best(clock).bound_ns == pytest.approx(MS + 5.1 * S * 100 * PPM, rel=1e-6)


@pytest.mark.parametrize(
    "stamps",
    [
        (100, 0, 201, 300),  # the peer held it for longer than it was away
        (300, 0, 0, 299),  # it came back before it was sent
        (100, 200, 150, 300),  # the peer answered before it was asked
        (-(2**63), 2**63 - 1, 2**63 - 1, S),  # an offset that no message could carry
        (S, -(2**63), -(2**63), S),
    ],
)
def test_an_exchange_that_can_not_be_is_ignored(stamps: tuple[int, int, int, int]) -> None:
    clock = ClockOffset()
    clock.update(*stamps)
    assert clock.best is None
    end_ns = exchange(clock, S, 5, MS, MS)
    clock.update(*stamps)
    assert best(clock) == OffsetEstimate(5, MS)
    assert end_ns


INT64 = st.integers(-(2**63), 2**63 - 1)


@given(INT64, INT64, INT64, st.integers(1, 2**60))
def test_whatever_the_peer_says_the_estimate_fits_into_a_message(t1: int, t2: int, t3: int, t4: int) -> None:
    clock = ClockOffset()
    clock.update(t1, t2, t3, t4)
    if clock.best is not None:
        assert abs(clock.best.offset_ns) < 2**63
        assert 0 <= clock.best.bound_ns < 2**63


DELAY = st.integers(0, 300 * MS)
TRUE_DELAY = st.integers(MS // 100, 300 * MS)  # no network is faster than a peer's answer can drift
PAUSE, ANSWER = st.integers(1, 3 * S), st.integers(0, 50 * MS)


def exchanges_of(delay: st.SearchStrategy[int]) -> st.SearchStrategy[list[tuple[int, int, int, int]]]:
    return st.lists(st.tuples(PAUSE, delay, delay, ANSWER), min_size=1, max_size=40)


@given(st.integers(-(10**15), 10**15), exchanges_of(DELAY))
def test_the_true_offset_is_always_within_the_bound(
    offset_ns: int, exchanges: list[tuple[int, int, int, int]]
) -> None:
    clock = ClockOffset()
    now_ns = 0
    for pause_ns, there_ns, back_ns, peer_ns in exchanges:
        now_ns = exchange(clock, now_ns + pause_ns, offset_ns, there_ns, back_ns, peer_ns)
        assert abs(best(clock).offset_ns - offset_ns) <= best(clock).bound_ns


@given(st.integers(-(10**15), 10**15), st.integers(-95, 95), exchanges_of(TRUE_DELAY))
def test_the_true_offset_stays_within_the_bound_of_clocks_that_drift(
    offset_ns: int, drift_ppm: int, exchanges: list[tuple[int, int, int, int]]
) -> None:
    clock = ClockOffset()

    def peer(stamp_ns: int) -> int:
        return stamp_ns + offset_ns + stamp_ns * drift_ppm // 1_000_000

    now_ns = 0
    for pause_ns, there_ns, back_ns, peer_ns in exchanges:
        t1 = now_ns + pause_ns
        t2, t3 = t1 + there_ns, t1 + there_ns + peer_ns
        now_ns = t3 + back_ns
        clock.update(t1, peer(t2), peer(t3), now_ns)
        away_ns = abs(best(clock).offset_ns - (peer(now_ns) - now_ns))
        within_the_exchange_ns = (there_ns + peer_ns + back_ns) // 10_000 + 3  # and whole nanoseconds
        assert away_ns <= best(clock).bound_ns + within_the_exchange_ns


def test_the_drift_of_two_hosts_on_a_local_network_is_followed() -> None:
    clock = ClockOffset()
    worst_ns = 0
    for now_ns in accumulate([50 * MS] * 7_200, initial=S):  # six minutes of heartbeats at 20 Hz
        there_ns = MS // 10 + now_ns // (50 * MS) % 7 * 10_000  # a local network: 0.1 to 0.16 ms
        offset_ns = int(now_ns * 100 * PPM)
        end_ns = exchange(clock, now_ns, offset_ns, there_ns, MS // 10)
        error_ns = abs(best(clock).offset_ns - int(end_ns * 100 * PPM))
        assert error_ns <= best(clock).bound_ns
        worst_ns = max(worst_ns, error_ns, best(clock).bound_ns)
    assert worst_ns < MS // 4
