"""What is drawn: shares, noise, motions, the same again, and nothing of the product."""

from math import exp, pi
from typing import Any

import numpy as np
import pytest

from tests.hidden_effects.generator import VOCABULARY, draw
from tests.hidden_effects.generator.bounds import relative_bounds
from tests.hidden_effects.generator.leftover import columns, silent
from tests.hidden_effects.generator.motion import MOTIONS, RICH, drawn_motion
from tests.hidden_effects.generator.noise import whitened
from tests.hidden_effects.generator.rivals import inseparable

_SHORT: dict[str, Any] = {"longest_s": 14.0, "fastest_hz": 300.0}


@pytest.mark.parametrize("name", VOCABULARY)
def test_share_is_what_the_recording_shows(name: str) -> None:
    """The reading with the effect less the reading without, both free of noise."""
    hidden = draw(name, 2, **_SHORT)
    base = silent(hidden, ())
    added = silent(hidden) - base
    spread = float(np.std(added)) if name != "bias" else float(np.sqrt(np.mean(added**2)))
    tolerance = 0.35 if name == "sensor_spikes" else 0.05
    assert spread / float(np.std(base)) == pytest.approx(hidden.truth.shares[0], rel=tolerance)


def test_the_same_again_and_something_else() -> None:
    first, again, other = (draw("backlash+bias", seed, **_SHORT) for seed in (4, 4, 5))
    assert np.array_equal(first.force_n, again.force_n)
    assert np.array_equal(first.time_s, again.time_s)
    assert not np.array_equal(first.force_n[:100], other.force_n[:100])
    assert first.truth.names == ("backlash", "bias")


def test_noise_has_the_stated_size_and_corner() -> None:
    hidden = draw("nothing", 11)
    noise = hidden.force_n - silent(hidden)
    truth = hidden.truth.noise
    assert np.std(noise) == pytest.approx(np.hypot(truth.rms_n, truth.white_n), rel=0.1)
    interval_s = float(np.median(np.diff(hidden.time_s)))
    neighbours = float(np.corrcoef(noise[1:], noise[:-1])[0, 1])
    share = truth.rms_n**2 / (truth.rms_n**2 + truth.white_n**2)
    assert neighbours == pytest.approx(share * exp(-2.0 * pi * truth.corner_hz * interval_s), abs=0.05)


@pytest.mark.parametrize("kind", sorted(MOTIONS))
def test_velocity_and_acceleration_are_the_derivatives(kind: str) -> None:
    motion = drawn_motion(np.random.default_rng(3), kind, 10.0, inserted=True)
    inner = slice(20, -20)
    for whole, rate in ((motion.x, motion.v), (motion.v, motion.a)):
        error = np.gradient(whole, motion.t)[inner] - rate[inner]
        assert np.sqrt(np.mean(error**2)) <= 2e-3 * max(float(np.std(rate)), 1e-6)
    assert np.min(motion.x) >= 0.0


def test_the_bound_is_the_spread_of_the_best_estimator() -> None:
    """Generalised least squares over drawn noise; the bound of a linear parameter is its exact spread."""
    hidden = draw("quadratic_drag", 6, **_SHORT)
    truth, rng = hidden.truth, np.random.default_rng(2)
    v = columns(hidden)[:, 1]
    phi = np.column_stack((v * np.abs(v), columns(hidden)))
    white = whitened(phi, truth.noise, truth.rate_hz)
    found = np.linalg.lstsq(white, rng.standard_normal((len(white), 600)), rcond=None)[0][0]
    value = truth.parameters["quadratic_drag"]["drag_n_s2_m2"]
    assert relative_bounds(hidden)["quadratic_drag"]["drag_n_s2_m2"] == pytest.approx(
        np.std(found) / value, rel=0.1
    )


def test_rich_motions_separate_full_sizes() -> None:
    for name in ("coulomb_friction", "bias", "quadratic_drag", "stress_relaxation"):
        hidden = draw(name, 8, **_SHORT)
        assert hidden.truth.motion in RICH
        assert inseparable(hidden) == ()
