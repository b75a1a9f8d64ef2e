"""The time offset of a force whose shift is known."""

import numpy as np
import pytest

from forefeel.common.time_offset import LONGEST_OFFSET_S, time_offset_s

T = np.arange(0.0, 20.0, 0.004)


def force_n(t: np.ndarray) -> np.ndarray:
    """Of two periods that are no multiples of each other."""
    return np.asarray(np.sin(2 * np.pi * 0.7 * t) + 0.4 * np.sin(2 * np.pi * 1.9 * t + 1.0))


@pytest.mark.parametrize("late_s", [-0.31, -0.002, 0.0, 0.0231, 0.3, 0.9])
def test_a_shift_is_told_to_a_millisecond_whatever_scale_bias_and_noise(late_s: float) -> None:
    estimate_n = 3.0 + 0.8 * force_n(T - late_s) + np.random.default_rng(1).normal(0, 0.05, len(T))
    assert time_offset_s(T, estimate_n, force_n(T)) == pytest.approx(late_s, abs=1e-3)


def test_gaps_missing_rows_and_the_order_of_rows_do_not_move_it() -> None:
    t = np.concatenate([T[:2000], T[2000:] + 4.0])
    estimate_n, true_n = force_n(t - 0.05), force_n(t)
    estimate_n[700:1100] = np.nan
    true_n[3000:3100] = np.nan
    assert time_offset_s(t, estimate_n, true_n) == pytest.approx(0.05, abs=1e-3)
    t[2000:] += 1e11  # a grid over all of it fits in no memory
    assert time_offset_s(t, estimate_n, true_n) == pytest.approx(0.05, abs=1e-3)
    order = np.random.default_rng(2).permutation(len(t))
    assert time_offset_s(t[order], estimate_n[order], true_n[order]) == time_offset_s(t, estimate_n, true_n)
    slow = T[::50]  # 5 Hz: every pause is a gap
    assert time_offset_s(slow, force_n(slow), force_n(slow)) is None


def test_what_does_not_vary_or_is_too_late_has_none() -> None:
    assert time_offset_s(T, np.full_like(T, 2.0), force_n(T)) is None
    assert time_offset_s(T, np.full_like(T, np.nan), force_n(T)) is None
    assert time_offset_s(T[:1], T[:1], T[:1]) is None
    pulse = np.exp(-(((T - 8.0) / 0.8) ** 2))
    later = np.exp(-(((T - 8.0 - 1.5 * LONGEST_OFFSET_S) / 0.8) ** 2))
    assert time_offset_s(T, later, pulse) is None


def test_stamps_whose_grid_is_rounded_past_their_end_are_read() -> None:
    time_s = np.asarray(0.1 + 0.001 * np.arange(21), dtype=np.float64)
    assert np.arange(time_s[0], time_s[-1], 0.005)[-1] > time_s[-1]
    force_n = np.sin(300.0 * time_s)
    assert time_offset_s(time_s, force_n, force_n) == pytest.approx(0.0, abs=1e-3)
