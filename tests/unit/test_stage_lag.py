"""The drive's lag, against drives of which it is known."""

from math import cos, inf, nan, pi, sin
from random import Random

import numpy as np
import pytest

from forefeel.common.estimation.stage_lag import StageLag

DT_S = 1e-3
MS = 1_000_000
DELAY_TICKS = 150


def _reach(t: float) -> float:
    """A stroke with 1.3 Hz on it, at most 60 mm/s."""
    return 0.02 * (1 - cos(2 * pi * 0.3 * t)) + 0.002 * sin(2 * pi * 1.3 * t)


class Drive:
    """w^2 / (s + w)^2 without feed-forward (lag 2 / w), or (2 w s + w^2) / (s + w)^2 with it (lag zero)."""

    def __init__(self, w: float, feed_forward: bool) -> None:
        self._w, self._feed = w, feed_forward
        self.x = self.v = 0.0
        self._before = 0.0

    def step(self, target: float) -> float:
        feed = (target - self._before) / DT_S if self._feed else 0.0
        self._before = target
        for _ in range(10):
            h = DT_S / 10
            self.v += h * self._w * (self._w * (target - self.x) + 2.0 * (feed - self.v))
            self.x += h * self.v
        return self.x


def _run(drive: Drive, seconds: float, lose: int = 0) -> tuple[StageLag, float, float]:
    """(what was learned, rms deviation of the stage from its command, and from what was expected), the
    last two over the second half.
    """
    lag, readbacks_m, errors_m = StageLag(), list[float](), list[tuple[float, float]]()
    ticks = int(seconds / DT_S)
    for n in range(ticks):
        command_m = _reach(n * DT_S)
        expected_m = lag.command(n * MS, command_m)
        readbacks_m.append(drive.step(command_m))
        errors_m.append((readbacks_m[n] - command_m, readbacks_m[n] - expected_m))
        arrived = n - DELAY_TICKS
        if arrived >= 0 and (not lose or arrived % lose):
            lag.observe(arrived * MS, readbacks_m[arrived])
    raw_m, left_m = np.sqrt(np.mean(np.square(errors_m[ticks // 2 :]), axis=0))
    return lag, float(raw_m), float(left_m)


@pytest.mark.parametrize("lose", [0, 10])
def test_the_lag_of_a_servo_is_found_across_the_delay(lose: int) -> None:
    """Bandwidth 5 Hz: T1 = 2 / w = 64 ms, T2 = 3 / w^2; a tenth of the readbacks is lost."""
    w = 2 * pi * 5.0
    lag, raw_m, expected_m = _run(Drive(w, feed_forward=False), 12.0, lose)
    assert lag.lags[0] == pytest.approx(2 / w, rel=0.05)
    assert lag.lags[1] == pytest.approx(3 / w**2, rel=0.25)
    assert expected_m < 0.1 * raw_m


def test_feed_forward_leaves_only_the_part_under_acceleration() -> None:
    w = 2 * pi * 5.0
    lag, raw_m, expected_m = _run(Drive(w, feed_forward=True), 12.0)
    assert abs(lag.lags[0]) < 0.002
    assert lag.lags[1] == pytest.approx(-1 / w**2, rel=0.25)
    assert expected_m < 0.35 * raw_m


def test_before_enough_is_seen_the_command_is_expected_as_it_is() -> None:
    lag = StageLag()
    for n in range(1000):
        assert lag.command(n * MS, _reach(n * DT_S)) == _reach(n * DT_S)
        lag.observe(n * MS, 0.5 * _reach(n * DT_S))
    assert lag.lags == (0.0, 0.0)


@pytest.mark.parametrize("nonsense", [nan, inf, -inf])
def test_numbers_that_are_none_are_left_out(nonsense: float) -> None:
    lag, _, _ = _run(Drive(2 * pi * 5.0, feed_forward=False), 6.0)
    before = lag.lags
    lag.command(7000 * MS, nonsense)
    lag.observe(5999 * MS, nonsense)
    lag.observe(12 * MS, 0.01)  # long ago
    lag.observe(99_999 * MS, 0.01)  # never sent
    assert lag.lags == before


def test_a_hand_that_trembles_while_it_holds_takes_nothing_away() -> None:
    """12 s of motion, 100 s of tremor of 5 um; the stage follows 60 ms late. 250 Hz."""
    lag, random = StageLag(), Random(1)
    commands_m = [_reach(n * 0.004) for n in range(3000)]
    commands_m += [_reach(12.0) + random.gauss(0.0, 5e-6) for _ in range(25_000)]
    for n in range(15, len(commands_m)):
        lag.command(4 * n * MS, commands_m[n])
        lag.observe(4 * n * MS, commands_m[n - 15])
        if n == 2999:
            before = lag.lags[0]
    assert before == pytest.approx(0.06, rel=0.03)
    assert lag.lags[0] == pytest.approx(before, rel=0.02)
