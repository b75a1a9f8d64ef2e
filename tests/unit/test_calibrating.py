"""The line through the loads, and when a calibration is refused."""

from contextlib import nullcontext
from math import sqrt
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.calibrate import measuring
from forefeel.common.errors import RunError


def still(native: float) -> measuring.Level:
    return measuring.Level(native, 0.0, 0.0, 0.0, 40)


def steps(*pairs: tuple[float, float]) -> list[measuring.Step]:
    return [measuring.Step(force_n, still(native)) for force_n, native in pairs]


def test_a_level_is_mean_noise_and_rise_as_a_line_of_least_squares_has_them() -> None:
    random = Random(1)
    times_s = [0.01 * i + random.uniform(0.0, 0.004) for i in range(60)]
    natives = [5.0 + 0.7 * t + random.gauss(0.0, 0.2) for t in times_s]
    level = measuring.level_of(times_s, natives)
    (slope, _), covariance = np.polyfit(times_s, natives, 1, cov=True)
    span_s = times_s[-1] - times_s[0]
    assert level.mean == pytest.approx(np.mean(natives))
    assert level.drift == pytest.approx(slope * span_s)
    assert level.drift_std == pytest.approx(sqrt(covariance[0, 0]) * span_s)
    assert level.readings == 60


@pytest.mark.parametrize("times_s", [[0.0, 0.1], [0.2, 0.2, 0.2]])
def test_a_level_needs_readings_over_time(times_s: list[float]) -> None:
    with pytest.raises(ValueError, match="expected at least 3 over some time"):
        measuring.level_of(times_s, times_s)


@pytest.mark.parametrize(
    ("level", "word"),
    [
        (measuring.Level(0.0, 1.9, 0.49, 0.01, 50), None),
        (measuring.Level(0.0, 1.5, 0.9, 0.4, 10), None),  # noise explains that drift
        (measuring.Level(0.0, 2.1, 0.0, 0.01, 50), "noise 0.021 N rms, allowed 0.02 N"),
        (measuring.Level(0.0, 0.1, -0.6, 0.05, 50), r"drift -0.006 N .*, allowed 0.005 N"),
    ],
)
def test_level_that_moves_is_refused(level: measuring.Level, word: str | None) -> None:
    with pytest.raises(RunError, match=word) if word else nullcontext():
        measuring.require_steady(level, 0.01, 1.0, "1 N")


@given(
    st.floats(1e-6, 1e3).flatmap(lambda gain: st.sampled_from([gain, -gain])),
    st.floats(-1e4, 1e4),
    st.lists(st.integers(1, 60), min_size=1, max_size=6, unique=True),
)
def test_exact_readings_give_the_gain_and_zero_that_they_were_made_with(
    gain_n: float, zero: float, loads: list[int]
) -> None:
    walk = measuring.walk_of([0.1 * load for load in loads])
    found = measuring.fit(steps(*((force_n, zero + force_n / gain_n) for force_n in walk)))
    assert found.gain_n == pytest.approx(gain_n, rel=1e-6)
    assert gain_n * (zero - found.zero) == pytest.approx(0.0, abs=1e-6 * max(1.0, abs(gain_n * zero)))
    assert found.residual_n == pytest.approx(0.0, abs=1e-6 * max(1.0, abs(gain_n * zero)))


def test_hysteresis_is_the_difference_between_up_and_down_and_counts_as_residual() -> None:
    found = measuring.fit(steps((0.0, 0.0), (1.0, 10.0), (2.0, 20.0), (1.0, 10.4), (0.0, 0.2)))
    assert found.hysteresis_n == pytest.approx(abs(found.gain_n) * 0.4)
    natives, forces = np.array([0.0, 10.0, 20.0, 10.4, 0.2]), np.array([0.0, 1.0, 2.0, 1.0, 0.0])
    slope, zero = np.polyfit(forces, natives, 1)
    assert found.gain_n == pytest.approx(1.0 / slope)
    assert found.zero == pytest.approx(zero)
    assert found.residual_n == pytest.approx(np.sqrt(np.mean((forces - (natives - zero) / slope) ** 2)))


@pytest.mark.parametrize(
    "pairs",
    [
        [(0.0, 0.0), (1.0, 10.0), (2.0, 22.0)], [(0.0, 0.0), (1.0, 10.0), (2.0, 9.0), (1.0, 10.0)],
        [(0.0, 0.0), (1.0, -10.0), (0.0, -11.0)], [(0.0, 5.0), (1.0, 5.0)], [(0.0, 1.0), (0.0, 2.0)],
    ],
    ids=["bent", "swapped", "hysteresis", "same reading", "same load"],
)  # fmt: skip
def test_reading_that_does_not_follow_load_is_refused(pairs: list[tuple[float, float]]) -> None:
    with pytest.raises(RunError):
        measuring.require_line(measuring.fit(steps(*pairs)), 2.0, 0.01)
    measuring.require_line(measuring.fit(steps((0.0, 0.0), (1.0, 10.0), (2.0, 22.0))), 2.0, 0.05)


def test_loads_go_up_and_down_in_each_direction_from_none_to_none() -> None:
    assert measuring.walk_of([2.0, 1.0]) == [0.0, 1.0, 2.0, 1.0, 0.0]
    assert measuring.walk_of([1.0]) == [0.0, 1.0, 0.0]
    assert measuring.walk_of([-1.0, 1.0, -2.0]) == [0.0, 1.0, 0.0, -1.0, -2.0, -1.0, 0.0]
    assert measuring.walk_of([-1.0]) == [0.0, -1.0, 0.0]
    assert measuring.range_of([1.0, 2.0]) == (0.0, 2.0)
    assert measuring.range_of([-1.0, 2.0]) == (-1.0, 2.0)


def test_weights_are_forces_by_standard_gravity() -> None:
    assert measuring.forces_of("0,0.1, 0.2", 9.80665, "--weights") == pytest.approx([0.980665, 1.96133])


def test_a_travel_counts_from_the_reference_with_the_sign_of_the_settings_and_falls_not_short() -> None:
    measuring.require_travel((0.0, 0.1), (0.0, 0.1))
    with pytest.raises(RunError, match="travel"):
        measuring.require_travel((0.0, 0.099), (0.0, 0.1))
    assert measuring.travel_of(100.0, (100_100.0, 100.0), 1e6, 1) == (0.0, 0.1)
    assert measuring.travel_of(100.0, (100_100.0, 100.0), 1e6, -1) == (-0.1, 0.0)
