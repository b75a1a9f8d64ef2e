from collections.abc import Callable
from math import cos, pi, sin

import numpy as np
import pytest

from forefeel.common.estimation.identifiability import MAX_LENGTH, MAX_STATEMENTS, Array, analyse

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
    phi = np.array([(a, v, x, 1.0) for x, v, a in map(motion, np.arange(2000) * 0.01)]) / SCALES
    return np.asarray(phi.T @ phi)


@pytest.mark.parametrize(
    ("motion", "statements"),
    [
        (sine(1.0), ("m and k only as k - 1.00 m",)),
        (sine(2.0), ("m and k only as k - 4.00 m",)),
        (sine(10.0), ("m and k only as k - 100. m",)),
        (two_sines, ()),
        (still, ("m and b not excited", "k and bias only as bias + 0.500 k")),
        (steady, ("m not excited", "b and bias only as bias + 0.100 b")),
    ],
)
def test_a_motion_tells_apart_what_it_excites(motion: Motion, statements: tuple[str, ...]) -> None:
    assert analyse(gathered(motion), NAMES, SCALES) == statements


def test_before_any_sample_nothing_is_excited() -> None:
    assert analyse(np.zeros((4, 4)), NAMES, SCALES) == ("m, b, k and bias not excited",)


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
