"""What is read from motions, on motions that are known."""

import numpy as np
import pytest

from tests.net.evidence import Floats, rest, set_right

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
    found = set_right(true_s + step_s * stepped, sequence, arrived_s, step_s, 101.4995)
    assert found == pytest.approx(true_s, abs=1e-6)
    few = np.array([0, 1700, 3000])
    found = set_right((true_s + step_s * stepped)[few], sequence[few], arrived_s[few], step_s, 101.4995)
    assert found == pytest.approx(true_s[few], abs=1e-6)
