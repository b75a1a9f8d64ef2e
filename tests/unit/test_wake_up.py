"""How early a loop stops sleeping follows how late the kernel wakes it."""

import numpy as np
import pytest

from forefeel.common.runtime.realtime import WakeUp


@pytest.mark.parametrize("usual_us", [5.0, 15.0])
def test_one_wake_up_in_a_hundred_is_later(usual_us: float) -> None:
    draw, wake_up = np.random.default_rng(1), WakeUp()
    later = []
    for late_ns in 25e3 + draw.exponential(1e3 * usual_us, 60_000):
        later.append(late_ns > wake_up.spin_ns)
        wake_up.note(int(late_ns))
    assert 0.006 < float(np.mean(later[20_000:])) < 0.014


def test_a_machine_that_stalls_is_followed_no_further_than_bounds() -> None:
    wake_up = WakeUp()
    for _ in range(20_000):
        wake_up.note(0)
    assert wake_up.spin_ns == 20_000
    for _ in range(200):
        wake_up.note(5_000_000)
    assert wake_up.spin_ns == 150_000
