"""A prior that is wrong in the dangerous direction: too soft, and the wall too far away."""

import numpy as np
import pytest

from forefeel.common.causes.motion import Motion
from forefeel.common.estimation.contact_prior import CONTACT, exactly, widened
from tests.unit.contact_samples import DT_S, TRUE, session, world
from tests.unit.predictor_samples import Array, Sample, replayed

DELAY_S = 0.3
SPRING = "mass_damper_spring.stiffness_n_m"
SOFT_AND_FAR = {**TRUE, SPRING: TRUE[SPRING] / 2.0, CONTACT: TRUE[CONTACT] + 0.003}


def strokes() -> Sample:
    """In and out of contact from the first second on."""
    moved = session(8.0, seed=2)
    return Sample(moved.t, moved.x, moved.force_n)


def pushed(duration_s: float) -> Sample:
    """Strokes in front of the wall, of which the prior is right; then, from the fourth second on, 20 mm."""
    t = np.arange(0.0, 10.0, DT_S)
    u = np.clip((t - 4.0) / duration_s, 0.0, 1.0)
    free = 0.003 * (1.0 - np.cos(2.0 * np.pi * 0.5 * np.clip(t, 0.0, 4.0)))
    x: Array = free + 0.02 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    v = np.gradient(x, t)
    force_n = world().runtime().forces_n(Motion.of(t, x, v, np.gradient(v, t)))
    return Sample(t, x, force_n + 0.002 * np.random.default_rng(1).standard_normal(len(t)))


@pytest.mark.parametrize(
    "sample", [strokes(), pushed(0.4), pushed(5.0)], ids=["strokes", "a blow", "a slow push"]
)
def test_a_wall_that_the_prior_has_too_soft_and_too_far_away_is_felt_within_a_second(sample: Sample) -> None:
    said = replayed(sample, DELAY_S, prior=widened(exactly(SOFT_AND_FAR), 1.0))
    touched_s = float(sample.t[np.argmax(sample.x > TRUE[CONTACT])])
    after_s, largest_n = sample.t - touched_s, float(np.abs(sample.f).max())

    first = (after_s >= 0.0) & (after_s < 1.0)
    assert 0.05 * largest_n < said.rms(sample.f, first) < 1.2 * said.zoh_rms(sample.f, first)
    later_s = np.arange(1.0, after_s[-1] - 0.25, 0.25)
    left_n = [said.rms(sample.f, (after_s >= s) & (after_s < s + 0.25)) for s in later_s]
    assert max(left_n) < 0.15 * largest_n
