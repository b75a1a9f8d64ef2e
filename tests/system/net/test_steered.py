"""A clock that is made wrong: every clock of the process departs, and the host's own one does not."""

import time
from collections.abc import Iterator

import pytest

from forefeel.common.clock import MonotonicClock
from tests.system.net.steered import Steering


@pytest.fixture
def clock() -> Iterator[MonotonicClock]:
    """The process's clocks are right again afterwards."""
    before = MonotonicClock.read_ns
    yield MonotonicClock()
    MonotonicClock.read_ns = staticmethod(before)


def ahead_s(clock: MonotonicClock) -> float:
    return (clock.now_ns() - time.monotonic_ns()) * 1e-9


@pytest.mark.parametrize("step_s", [1.0, -1.0])
def test_a_clock_that_is_set_stays_off_by_as_much(clock: MonotonicClock, step_s: float) -> None:
    assert ahead_s(clock) == pytest.approx(0.0, abs=0.01)
    Steering(step_s).begin()
    assert ahead_s(clock) == pytest.approx(step_s, abs=0.01)
    assert ahead_s(MonotonicClock()) == pytest.approx(step_s, abs=0.01), "whoever made it"


@pytest.mark.parametrize("rate", [0.08, -0.08, 500e-6])
def test_a_clock_gains_its_rate_and_stamps_are_set_right_by_the_inverse(rate: float) -> None:
    steering, from_ns = Steering(rate=rate), 5_000_000_000
    shown_ns = steering.shown_ns(from_ns + 10_000_000_000, from_ns)
    assert shown_ns == 15_000_000_000 + round(10e9 * rate)
    assert steering.host_s(shown_ns * 1e-9, 5.0) == pytest.approx(15.0, abs=1e-9)
    assert Steering(*map(float, steering.words)) == steering, "as the command line has it"


def test_who_sleeps_by_a_fast_clock_does_not_wake_early(clock: MonotonicClock) -> None:
    Steering(rate=1.0).begin()
    deadline_ns = clock.now_ns() + 20_000_000
    clock.sleep_until_ns(deadline_ns)
    assert clock.now_ns() >= deadline_ns
