"""The motion that a bench is asked for, within any limits."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.diagnosis.excitation import Limits, excitation

DT_S = 1e-3
ROUNDING_M = 1e-15  # of a position of up to 0.5 m in double precision


@st.composite
def all_limits(draw: st.DrawFn) -> Limits:
    """From a stage that crosses its range in a tenth of a second to one that needs half a minute."""
    low_m, span_m = draw(st.floats(-0.1, 0.1)), 10.0 ** draw(st.floats(-4.0, -0.5))
    crossing_s, rising_s = 10.0 ** draw(st.floats(-1.0, 1.5)), 10.0 ** draw(st.floats(-2.0, 0.5))
    speed_m_s = span_m / crossing_s
    return Limits(low_m, low_m + span_m, speed_m_s, speed_m_s / rising_s)


@settings(max_examples=60)
@given(all_limits(), st.floats(10.0, 60.0), st.floats(20.0, 1000.0))
def test_motion_stays_within_limits_and_ends_at_rest_at_home(
    limits: Limits, duration_s: float, rate_hz: float
) -> None:
    x = excitation(limits, duration_s, rate_hz).position_m
    assert limits.low_m - ROUNDING_M <= x.min() < x.max() <= limits.high_m + ROUNDING_M
    assert np.max(np.abs(np.diff(x))) <= limits.speed_m_s * DT_S + 2.0 * ROUNDING_M
    assert np.max(np.abs(np.diff(x, 2))) <= limits.acceleration_m_s2 * DT_S**2 + 4.0 * ROUNDING_M
    assert np.max(np.abs(x[[0, 1, -2, -1]] - limits.home_m)) < 1e-9
    assert abs(len(x) * DT_S - duration_s) <= 0.1 * duration_s


def test_same_limits_give_the_same_motion() -> None:
    limits = Limits(0.01, 0.05, 0.02, 0.3)
    first, again, slower = (excitation(limits, rate_hz=hz).position_m for hz in (100.0, 100.0, 20.0))
    np.testing.assert_array_equal(first, again)
    assert np.max(np.abs(first - slower[: len(first)])) > 1e-3  # a sweep up to a fifth of the rate
