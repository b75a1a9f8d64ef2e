from collections.abc import Callable
from math import cos, pi, sin

import numpy as np
import pytest

from forefeel.common.estimation.identifiability import (
    MAX_LENGTH,
    MAX_STATEMENTS,
    Array,
    analyse,
)

NAMES = ("m", "b", "k", "bias")
SCALES = (1.0, 0.5, 0.25, 1.0)
Motion = Callable[[float], tuple[float, float, float]]


def still(t: float) -> tuple[float, float, float]:
    return 0.5, 0.0, 0.0


def steady(t: float) -> tuple[float, float, float]:
    return 0.1 * t, 0.1, 0.0


def sine(w: float) -> Motion:
    return lambda t: (sin(w * t), w * cos(w * t), -w * w * sin(w * t))


def two_sines(t: float) -> tuple[float, float, float]:
    slow, fast = sine(1.0)(t), sine(pi)(t)
    return slow[0] + fast[0], slow[1] + fast[1], slow[2] + fast[2]


def gathered(motion: Motion) -> Array:
    """20 s at 100 Hz, straight from the definition."""
    rows = [
        (a / SCALES[0], v / SCALES[1], x / SCALES[2], 1.0) for x, v, a in map(motion, np.arange(2000) * 0.01)
    ]
    phi = np.array(rows)
    return np.asarray(phi.T @ phi)


def verdict(motion: Motion) -> tuple[str, ...]:
    return analyse(gathered(motion), NAMES, SCALES)


@pytest.mark.parametrize(("w", "factor"), [(1.0, "1.00"), (2.0, "4.00"), (10.0, "100.")])
def test_a_pure_sine_leaves_only_k_less_w_squared_m(w: float, factor: str) -> None:
    assert verdict(sine(w)) == (f"m and k only as k - {factor} m",)


def test_two_frequencies_identify_all() -> None:
    assert verdict(two_sines) == ()


def test_standstill_leaves_the_level_of_force_only() -> None:
    expected = ("m and b not excited", "k and bias only as bias + 0.500 k")
    assert verdict(still) == expected


def test_at_constant_speed_damping_and_bias_are_one() -> None:
    expected = ("m not excited", "b and bias only as bias + 0.100 b")
    assert verdict(steady) == expected


def test_before_any_sample_nothing_is_excited() -> None:
    expected = ("m, b, k and bias not excited",)
    assert analyse(np.zeros((4, 4)), NAMES, SCALES) == expected


def test_a_combination_of_three_is_named_as_such() -> None:
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(2, 500))
    phi = np.array([p, q, p + q])
    expected = ("m, b and k not separable",)
    assert analyse(phi @ phi.T, NAMES[:3], (1.0,) * 3) == expected


def test_two_pairs_are_two_statements() -> None:
    rng = np.random.default_rng(2)
    p, q = rng.normal(size=(2, 500))
    phi = np.array([p, q, -2.0 * p, 5.0 * q])
    statements = analyse(phi @ phi.T, NAMES, (1.0,) * 4)
    assert sorted(statements) == ["b and bias only as bias + 0.200 b", "m and k only as k - 0.500 m"]


def test_statements_are_few_and_short_whatever_the_model() -> None:
    names = [f"effect_of_a_long_name.parameter_{i}" for i in range(20)]
    pairs = np.random.default_rng(3).normal(size=(10, 500)).repeat(2, axis=0)
    for matrix in (np.zeros((20, 20)), pairs @ pairs.T, np.full((20, 20), 100.0)):
        statements = analyse(matrix, names, [1.0] * 20)
        assert 1 <= len(statements) <= MAX_STATEMENTS
        assert max(map(len, statements)) <= MAX_LENGTH
