"""What is read from motions, on motions that are known."""

import numpy as np
import pytest

from tests.system.net.evidence import Felt, Floats, felt_stale_s, rest, set_right
from tests.system.net.steered import Steering

TIME_S: Floats = np.arange(3000, dtype=np.float64) * 1e-3


def motion(moving_s: list[tuple[float, float]], speed_m_s: float = 0.05) -> Floats:
    """Positions of a stage that moves only in these spans."""
    speed = np.zeros(len(TIME_S))
    for start_s, end_s in moving_s:
        speed[(start_s <= TIME_S) & (end_s > TIME_S)] = speed_m_s
    return np.asarray(np.cumsum(speed) * 1e-3, dtype=np.float64)


def test_a_stage_that_stops_is_at_rest_from_then_on() -> None:
    found = rest(TIME_S, motion([(0.0, 0.12)]), 0.0)
    assert found.after_s == pytest.approx(0.12, abs=2e-3)
    assert found.moved_again_m == pytest.approx(0.0, abs=1e-5)


def test_one_that_never_stops_has_no_rest() -> None:
    assert rest(TIME_S, motion([(0.0, 3.0)]), 0.0).after_s is None


def test_a_short_pause_is_no_rest_and_what_moves_after_a_rest_is_seen() -> None:
    found = rest(TIME_S, motion([(0.0, 0.10), (0.15, 0.20), (2.0, 2.01)]), 0.0)
    assert found.after_s == pytest.approx(0.20, abs=2e-3)
    assert found.moved_again_m == pytest.approx(0.0005, rel=0.05)


@pytest.mark.parametrize("step_s", [1.0, -1.0])
def test_stamps_of_a_clock_that_was_set_are_set_right_up_to_the_next_process(step_s: float) -> None:
    true_s: Floats = np.arange(100_000, 104_000, dtype=np.float64) * 1e-3
    sequence = np.concatenate((np.arange(5000, 7500), np.arange(1, 1501)))
    stepped = (true_s > 101.5) & (true_s < 102.5)
    arrived_s: Floats = true_s + np.float64(0.002)
    found = set_right(true_s + step_s * stepped, sequence, arrived_s, Steering(step_s), 101.4995)
    assert found == pytest.approx(true_s, abs=1e-6)
    few = np.array([0, 1700, 3000])
    found = set_right(
        (true_s + step_s * stepped)[few], sequence[few], arrived_s[few], Steering(step_s), 101.4995
    )
    assert found == pytest.approx(true_s[few], abs=1e-6)


@pytest.mark.parametrize("rate", [0.08, -0.08, 0.0005])
def test_stamps_of_a_clock_that_was_too_fast_or_slow_are_set_right_up_to_the_next_process(
    rate: float,
) -> None:
    true_s: Floats = np.arange(100_000, 106_000, dtype=np.float64) * 1e-3
    sequence = np.concatenate((np.arange(5000, 9000), np.arange(1, 2001)))
    from_ns = 101_500_000_000
    wrong = (true_s > 101.5) & (sequence > 2000)
    shown_s = np.array([Steering(rate=rate).shown_ns(round(t * 1e9), from_ns) * 1e-9 for t in true_s])
    found = set_right(np.where(wrong, shown_s, true_s), sequence, true_s, Steering(rate=rate), 101.5)
    assert found == pytest.approx(true_s, abs=1e-6)
    assert np.abs(shown_s - true_s)[wrong].max() == pytest.approx(2.5 * abs(rate), rel=0.01)


def felt(age_s: Floats, force_n: Floats, sessions: Floats | None = None) -> Felt:
    session = np.ones(len(age_s)) if sessions is None else sessions
    return Felt(TIME_S[: len(age_s)], force_n, age_s, session.astype(np.int64))


def test_a_hand_that_feels_an_old_force_is_found_out_and_one_whose_force_fades_is_not() -> None:
    """The newest force is 150 ms old, and from 1 s on it ages."""
    age_s: Floats = 0.150 + np.maximum(TIME_S - 1.0, 0.0)
    until = [1.25, 2.5]
    for until_s, stale_s in zip(until, (0.15, 1.4), strict=True):
        hand_n = np.where(until_s > TIME_S, 0.2, 0.0)
        assert felt_stale_s(felt(age_s, hand_n), 0.1) == pytest.approx(stale_s, abs=3e-3)


def test_a_force_is_judged_by_the_fastest_way_of_its_own_session() -> None:
    """10 ms; 250 ms in the same session, where the hand feels it; 250 ms as usual in the next session."""
    age_s = np.where(TIME_S < 1.0, 0.010, 0.250)
    hand_n = np.full(len(TIME_S), 0.2)
    assert felt_stale_s(felt(age_s, hand_n, np.where(TIME_S < 1.0, 1.0, 2.0)), 0.1) == 0.0
    late = felt(age_s, hand_n, np.where(TIME_S < 2.0, 1.0, 2.0))
    assert felt_stale_s(late, 0.1) == pytest.approx(1.0, abs=3e-3)
    assert felt_stale_s(felt(age_s[::-1], hand_n), 0.1) == 0.0, "the way became shorter"
