"""The detector, in virtual time, on made-up errors."""

import numpy as np
import pytest

from forefeel.dashboard.detector import ModelWatch


def live(
    watch: ModelWatch, start: int, stop: int, innovation_n: float, outside: float, seed: int = 0
) -> None:
    """Seconds of forces and innovations around these."""
    rng = np.random.default_rng([seed, start])
    for second in range(start, stop):
        spread = 1 + 0.15 * rng.normal()
        for tick in range(250):
            t_s = second + tick * 4e-3
            watch.force(t_s, bool(rng.random() < outside))
            if tick % 50 == 0:
                watch.innovation(t_s, innovation_n * spread)


def test_half_an_hour_of_nothing_raises_no_alarm() -> None:
    watch = ModelWatch()
    for part in range(6):
        live(watch, 50 * part, 50 * part + 50, 0.005, 0.05, part)
        assert watch.alarm is None
    assert watch.signs.innovation_ratio == pytest.approx(1.0, abs=0.5)


def test_a_model_that_goes_wrong_is_noticed_within_three_seconds_and_since_when_is_right() -> None:
    watch = ModelWatch()
    live(watch, 0, 20, 0.005, 0.05)
    live(watch, 20, 23, 0.015, 0.05)
    assert watch.alarm is not None
    assert watch.alarm.since_s == 20.0
    assert watch.alarm.innovation_ratio == pytest.approx(3.0, rel=0.5)


def test_forces_outside_of_the_band_are_a_sign_of_their_own() -> None:
    watch = ModelWatch()
    live(watch, 0, 20, 0.005, 0.05)
    live(watch, 20, 24, 0.005, 0.6)
    assert watch.alarm is not None
    assert watch.alarm.outside_share == pytest.approx(0.6, abs=0.1)


def test_an_alarm_ends_only_when_it_has_been_good_for_a_while() -> None:
    watch = ModelWatch()
    live(watch, 0, 20, 0.005, 0.05)
    live(watch, 20, 30, 0.02, 0.05)
    live(watch, 30, 33, 0.005, 0.05)
    assert watch.alarm is not None
    live(watch, 33, 34, 0.02, 0.05)
    live(watch, 34, 38, 0.005, 0.05)
    assert watch.alarm is not None
    live(watch, 38, 41, 0.005, 0.05)
    assert watch.alarm is None


def test_what_is_wrong_does_not_become_usual() -> None:
    watch = ModelWatch()
    live(watch, 0, 20, 0.005, 0.05)
    live(watch, 20, 200, 0.02, 0.05)
    assert watch.alarm is not None
    assert watch.alarm.since_s == 20.0
    assert watch.signs.innovation_ratio == pytest.approx(4.0, rel=0.5)


def test_one_bad_second_is_no_alarm() -> None:
    watch = ModelWatch()
    live(watch, 0, 20, 0.005, 0.05)
    live(watch, 20, 21, 0.05, 0.9)
    live(watch, 21, 25, 0.005, 0.05)
    assert watch.alarm is None


def test_a_hand_at_rest_says_nothing() -> None:
    watch = ModelWatch()
    live(watch, 0, 20, 0.005, 0.05)
    for second in range(20, 40):
        watch.innovation(second + 0.5, 5.0)
    assert watch.alarm is None


def test_nothing_is_judged_before_the_usual_is_known() -> None:
    watch = ModelWatch()
    live(watch, 0, 3, 0.005, 0.05)
    live(watch, 3, 6, 0.05, 0.9)
    assert watch.alarm is None
