"""Whatever forces the predictor was given, and in whatever order, it predicts well again 5 s later."""

import numpy as np
import pytest

from forefeel.common.estimation.predictor import Predictor
from tests.unit.predictor_samples import contact

RATE_HZ, DELAY = 100, 20  # samples: 0.2 s
GOOD, BAD_UNTIL, WELL = 400, 600, 1100  # well: 5 s after the last bad force
CONTACT = contact(17.0, RATE_HZ)
COUNT = BAD_UNTIL - GOOD
RNG = np.random.default_rng(3)
BAD = {
    "1e300": np.full(COUNT, 1e300),
    "either end": np.tile([1e300, -1e300], COUNT // 2),
    "30 N": np.full(COUNT, 30.0),
    "zero": np.zeros(COUNT),
    "jumps": np.tile([50.0, -60.0], COUNT // 2),
    "wide": 10.0 ** RNG.uniform(-300, 300, COUNT) * RNG.choice([-1, 1], COUNT),
}


@pytest.mark.parametrize("learned", [True, False])
@pytest.mark.parametrize("bad", BAD)
def test_no_force_is_remembered_for_more_than_5_s(bad: str, learned: bool) -> None:
    forces = CONTACT.f.copy()
    forces[GOOD:BAD_UNTIL] = BAD[bad]
    begin = 0 if learned else GOOD  # the bad ones come after good ones, or first
    predictor, said = Predictor(), np.full(len(forces), np.nan)
    for n in range(begin, len(forces)):
        if n >= DELAY + begin:
            predictor.observe(CONTACT.t[n - DELAY], forces[n - DELAY])
        predictor.move(CONTACT.t[n], CONTACT.x[n])
        estimate = predictor.predict()
        if estimate is not None:
            assert np.isfinite(estimate[:3]).all()
            said[n] = estimate.force_n
    error = said[WELL:] - CONTACT.f[WELL:]
    held = CONTACT.f[WELL - DELAY : -DELAY] - CONTACT.f[WELL:]
    assert np.sqrt(np.mean(error**2)) < 0.7 * np.sqrt(np.mean(held**2))


def test_what_is_no_number_is_left_out() -> None:
    clean, dirty = Predictor(), Predictor()
    for n in range(600):
        for each in (clean, dirty):
            each.observe(CONTACT.t[n - DELAY], CONTACT.f[n - DELAY])
            each.move(CONTACT.t[n], CONTACT.x[n])
        for odd in (np.nan, np.inf, -np.inf):
            dirty.observe(CONTACT.t[n - DELAY], odd)
        assert dirty.predict() == clean.predict()
    assert dirty.learner.renewals == 0


@pytest.mark.parametrize("seed", range(2))
def test_a_contact_that_is_learned_is_never_forgotten(seed: int) -> None:
    sample, predictor = contact(60.0, RATE_HZ, seed, changed=3.0), Predictor()
    for n in range(DELAY, len(sample.t)):
        predictor.observe(sample.t[n - DELAY], sample.f[n - DELAY])
        predictor.move(sample.t[n], sample.x[n])
        predictor.predict()
    assert predictor.learner.renewals == 0
