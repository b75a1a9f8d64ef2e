"""What plain regressions see before the search."""

import numpy as np
import pytest

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.analysis import conditioned
from forefeel.diagnosis.sensor_faults import clean
from forefeel.diagnosis.verdict import Look

RATE_HZ, SECONDS = 100.0, 60.0
T = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ


def seen(x: Floats, force: Floats) -> Look:
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(T))
    recording = Recording("made", T, x, force + noise, "made.csv")
    return conditioned(recording, clean(recording)).look


def strokes() -> Floats:
    return np.asarray(5e-3 * np.sin(2 * np.pi * 0.7 * T) + 2e-3 * np.sin(2 * np.pi * 1.3 * T + 1.0))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_slow_force_does_not_turn_the_axis(way: float) -> None:
    """Position and force drift together, against the spring of the strokes, and by more than it."""
    slow = np.sin(2 * np.pi * 0.03 * T)
    found = seen(strokes() + 8e-3 * slow, way * 100.0 * strokes() - way * 3.0 * slow)
    assert found.sense == way
    assert found.spring_in_band > 0.95
    assert found.spring < 0.5


def test_dry_friction_tells_the_axis_where_nothing_else_resists() -> None:
    v = np.gradient(strokes(), T)
    for way in (1.0, -1.0):
        found = seen(strokes(), way * np.sign(v))
        assert (found.sense, found.family) == (way, "friction")


def test_no_mass_of_tons_stands_for_a_spring_of_a_slow_sine() -> None:
    x, late = (5e-3 * np.sin(2 * np.pi * 0.05 * (T - delay_s)) for delay_s in (0.0, 1.2))
    for way in (1.0, -1.0):
        assert seen(x, way * 5e3 * np.maximum(late - 1e-3, 0.0)).sense == way


def test_the_family_that_takes_most_is_seen_and_none_where_nothing_is_missing() -> None:
    x = strokes()
    assert seen(x, 100.0 * x).family is None
    assert seen(x, 100.0 * x + 5e6 * x**3).family == "stiffening"


def test_a_force_of_its_own_is_not_explained() -> None:
    own = np.cumsum(np.random.default_rng(4).standard_normal(len(T))) * 0.05
    assert seen(strokes(), own).explained < 0.3
