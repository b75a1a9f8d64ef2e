from collections.abc import Callable
from dataclasses import replace
from functools import partial
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.clock_offset import MAX_RATE_PPM, ClockOffset, OffsetEstimate
from tests.clocks import compared

Exchanges = list[tuple[int, int, int, int]]
Route = Callable[[float], tuple[int, int]]
Offset = Callable[[float], int]
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


@pytest.mark.parametrize("offset_ns", [0, 1, -1, 3 * S, -86_400 * S])
def test_equal_delays_give_the_offset_exactly(offset_ns: int) -> None:
    clock = ClockOffset()
    exchange(clock, S - 50 * MS, offset_ns, 7 * MS, 7 * MS)
    assert clock.best is None
    exchange(clock, S, offset_ns, 7 * MS, 7 * MS, peer_ns=40 * MS)
    assert abs(best(clock).bound_ns - 7 * MS) <= 0.1 * MS  # of the older of two exchanges
    assert best(clock) == replace(compared(offset_ns, 7 * MS), bound_ns=best(clock).bound_ns)
    assert best(clock).round_trip_ns == 14 * MS


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
    exchange(clock, S, 5, MS, MS)
    clock.update(*stamps)
    exchange(clock, S, 5, MS, MS)
    clock.update(*stamps)
    assert best(clock) == compared(5, MS)


DELAY = st.integers(0, 300 * MS)
TRUE_DELAY = st.integers(MS // 100, 300 * MS)  # no network is faster than a peer's answer can drift
PAUSE, ANSWER = st.integers(1, 3 * S), st.integers(0, 50 * MS)


def exchanges_of(delay: st.SearchStrategy[int]) -> st.SearchStrategy[Exchanges]:
    return st.lists(st.tuples(PAUSE, delay, delay, ANSWER), min_size=1, max_size=40)


@given(st.integers(-(10**15), 10**15), exchanges_of(DELAY))
def test_the_true_offset_is_always_within_the_bound(offset_ns: int, exchanges: Exchanges) -> None:
    clock = ClockOffset()
    now_ns = 0
    for pause_ns, there_ns, back_ns, peer_ns in exchanges:
        now_ns = exchange(clock, now_ns + pause_ns, offset_ns, there_ns, back_ns, peer_ns)
        assert clock.best is None or abs(clock.best.offset_ns - offset_ns) <= clock.best.bound_ns


@given(st.integers(-(10**15), 10**15), st.integers(-950, 950), exchanges_of(TRUE_DELAY))
def test_the_true_offset_stays_within_the_bound_of_clocks_that_drift(
    offset_ns: int, drift_ppm: int, exchanges: Exchanges
) -> None:
    clock = ClockOffset()

    def peer(stamp_ns: int) -> int:
        return stamp_ns + offset_ns + stamp_ns * drift_ppm // 1_000_000

    now_ns = before_ns = 0
    for pause_ns, there_ns, back_ns, peer_ns in exchanges:
        t1 = now_ns + pause_ns
        t2, t3 = t1 + there_ns, t1 + there_ns + peer_ns
        now_ns = t3 + back_ns
        clock.update(t1, peer(t2), peer(t3), now_ns)
        within_the_exchange_ns = (there_ns + peer_ns + back_ns) // 1000 + 3  # and whole nanoseconds
        if clock.best is not None:
            away_ns = abs(clock.best.offset_ns - (peer(now_ns) - now_ns))
            assert away_ns <= clock.best.bound_ns + max(within_the_exchange_ns, before_ns)
        before_ns = within_the_exchange_ns


def heartbeats(clock: ClockOffset, seconds: float, path: Route, offset: Offset, start_ns: int = S) -> int:
    """Exchanges at 20 Hz; `path`, `offset`: one-way delays and the peer's offset, in ns, at a time in s."""
    for now_ns in range(start_ns, start_ns + round(seconds * S), 50 * MS):
        there_ns, back_ns = path(now_ns / S)
        arrival_ns = now_ns + there_ns
        peer_ns = arrival_ns + offset(arrival_ns / S)
        clock.update(now_ns, peer_ns, peer_ns, arrival_ns + back_ns)
    return start_ns + round(seconds * S)


def jittered(mean_ns: int, half_width_ns: int, seed: int) -> Route:
    draw, ends_ns = Random(seed).uniform, (mean_ns - half_width_ns, mean_ns + half_width_ns)
    return lambda _: (round(draw(*ends_ns)), round(draw(*ends_ns)))


@pytest.mark.parametrize(("there_ns", "back_ns"), [(200 * MS, 10 * MS), (10 * MS, 200 * MS), (5, 5)])
@pytest.mark.parametrize("offset_ns", [0, -86_400 * S])
def test_the_excess_of_a_message_is_what_it_took_longer_however_the_route_is_split(
    there_ns: int, back_ns: int, offset_ns: int
) -> None:
    clock = ClockOffset()
    end_ns = heartbeats(clock, 2.0, lambda _: (there_ns, back_ns), lambda _: offset_ns)
    for late_ns in (0, 40 * MS, 480 * MS):
        transit_ns = (end_ns + back_ns + late_ns) - (end_ns + offset_ns)
        assert best(clock).excess_ns(transit_ns) == late_ns
        assert best(clock).ahead_ns(transit_ns) == 0
    assert best(clock).ahead_ns(-offset_ns - there_ns - 5 * MS) == pytest.approx(4 * MS, abs=0.3 * MS)


@pytest.mark.parametrize("lie_ns", [-300 * MS, -60 * MS, 60 * MS, 10 * S])
def test_a_lone_exchange_that_lies_makes_no_message_late_or_early(lie_ns: int) -> None:
    """Of the peer's receive stamp: at -300 ms the shortest round trip that can be, over a path of 150 ms."""
    clock = ClockOffset()
    end_ns = heartbeats(clock, 2.0, lambda _: (150 * MS, 150 * MS), lambda _: 0)
    clock.update(end_ns, end_ns + 150 * MS + lie_ns, end_ns + 150 * MS, end_ns + 300 * MS)
    for _ in range(2):
        assert best(clock).excess_ns(150 * MS) == best(clock).ahead_ns(150 * MS) == 0
        end_ns = heartbeats(clock, 2.0, lambda _: (150 * MS, 150 * MS), lambda _: 0, end_ns + 50 * MS)


def test_after_a_jump_of_the_delay_messages_are_late_and_after_the_way_back_they_are_not() -> None:
    clock = ClockOffset()
    end_ns = heartbeats(clock, 5.0, lambda _: (10 * MS, 10 * MS), lambda _: 0)
    assert best(clock).excess_ns(10 * MS) == 0
    end_ns = heartbeats(clock, 5.0, lambda _: (250 * MS, 250 * MS), lambda _: 0, end_ns)
    assert best(clock).excess_ns(250 * MS) == 480 * MS
    assert (best(clock).round_trip_ns, best(clock).least_round_trip_ns) == (500 * MS, 20 * MS)
    heartbeats(clock, 5.0, lambda _: (10 * MS, 10 * MS), lambda _: 0, end_ns)
    assert best(clock).excess_ns(10 * MS) == 0


@pytest.mark.parametrize("rate_ppm", [500, -1000, 83_333])
def test_a_clock_at_another_rate_makes_no_message_late_or_early(rate_ppm: int) -> None:
    clock = ClockOffset()

    def offset(time_s: float) -> int:
        return round(time_s * S * rate_ppm * PPM)

    end_ns = heartbeats(clock, 60.0, lambda _: (150 * MS, 150 * MS), offset)
    excess_ns = best(clock).excess_ns(150 * MS - offset(end_ns / S))
    assert abs(excess_ns) <= 1.6 * S * abs(rate_ppm) * PPM  # what it moves in a second and two round trips


@pytest.mark.parametrize("creep_s_s", [1.5e-3, 0.1e-3])
def test_a_delay_that_creeps_up_ages_every_message_however_slowly(creep_s_s: float) -> None:
    """On our way or on the peer's: a message that completes the longer round trip is late."""

    def crept_ns(time_s: float) -> int:
        return 150 * MS + round(time_s * creep_s_s * S)

    there, back = ClockOffset(), ClockOffset()
    heartbeats(there, 200.0, lambda t: (crept_ns(t), 150 * MS), lambda _: 0)
    heartbeats(back, 200.0, lambda t: (150 * MS, crept_ns(t)), lambda _: 0)
    late_ns = crept_ns(200.0) - 150 * MS
    assert best(there).excess_ns(150 * MS) == pytest.approx(late_ns, abs=2 * MS)
    assert best(back).excess_ns(crept_ns(200.0)) == pytest.approx(late_ns, abs=2 * MS)


@pytest.mark.parametrize("rate_ppm", [83_333, -83_333])
@pytest.mark.parametrize(("mean_ns", "jitter_ns"), [(10 * MS, 2 * MS), (150 * MS, 10 * MS)])
@pytest.mark.parametrize("seed", range(5))
def test_a_rate_that_is_not_followed_is_certain_within_seconds(
    rate_ppm: int, mean_ns: int, jitter_ns: int, seed: int
) -> None:
    clock = ClockOffset()
    seconds = 4.0 if jitter_ns < 5 * MS else 8.0
    heartbeats(clock, seconds, jittered(mean_ns, jitter_ns, seed), lambda t: round(t * S * rate_ppm * PPM))
    assert MAX_RATE_PPM < abs(best(clock).rate_ppm) <= abs(rate_ppm) * 1.001
    assert best(clock).rate_ppm * rate_ppm > 0


@pytest.mark.parametrize(("rate_ppm", "seed"), [(0, 0), (500, 1), (-1000, 2)])
def test_no_rate_that_is_followed_is_taken_for_one_that_is_not(rate_ppm: int, seed: int) -> None:
    """Neither with the jitter of the paper, nor over a route that changes, nor after a clock was set."""

    def offset(set_ns: int, time_s: float) -> int:
        return round(time_s * S * rate_ppm * PPM) + set_ns * (time_s > 30.0)

    for path in (
        jittered(150 * MS, 10 * MS, seed),
        jittered(20 * MS, 15 * MS, seed),
        lambda t: (10 * MS, (10 if t < 20.0 else 200) * MS),
        lambda t: (10 * MS + round(4 * MS * t), 10 * MS),
        lambda t: (400 * MS - round(4 * MS * t), 10 * MS),
    ):
        for step_ns in (0, S):
            clock = ClockOffset()
            for start_s in range(1, 61, 2):
                heartbeats(clock, 2.0, path, partial(offset, step_ns), start_s * S)
                assert abs(best(clock).rate_ppm) <= MAX_RATE_PPM * 1.01
