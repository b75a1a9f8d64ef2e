"""The recursions without loops against their loops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hidden_effects.generator.scan import one_pole, play, smoothed, varying_pole


@given(st.integers(0, 10_000), st.integers(1, 700))
def test_poles(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    drive, decay = rng.standard_normal(count), rng.uniform(0.0, 1.0, count)
    pole = complex(*rng.uniform(-0.7, 0.7, 2))
    real, turning, varying = 0.0, 0.0j, 0.0
    for n in range(count):
        real, turning = 0.9 * real + drive[n], pole * turning + drive[n]
        varying = decay[n] * varying + drive[n]
    assert smoothed(0.9, drive)[-1] == pytest.approx(real)
    assert one_pole(pole, drive.astype(complex))[-1] == pytest.approx(turning)
    assert varying_pole(decay, drive)[-1] == pytest.approx(varying)


@given(st.integers(0, 10_000), st.integers(1, 700), st.floats(0.0, 3.0))
def test_play(seed: int, count: int, width: float) -> None:
    x = np.cumsum(np.random.default_rng(seed).standard_normal(count))
    y, expected = x[0], []
    for now in x:
        y = min(max(y, now - 0.5 * width), now + 0.5 * width)
        expected.append(y)
    np.testing.assert_allclose(play(x, width), expected, atol=1e-12)
