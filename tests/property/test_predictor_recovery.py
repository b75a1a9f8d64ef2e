"""Whatever forces the predictor was given, and in whatever order, it predicts well again 20 s later."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from forefeel.common.estimation.predictor import Predictor
from tests.unit.predictor_samples import contact

RATE_HZ, DELAY = 100, 20  # samples: 0.2 s
GOOD, BAD_UNTIL, WELL = 400, 600, 2600
CONTACT = contact(31.0, RATE_HZ)
ANY = st.one_of(st.floats(), st.floats(-100.0, 100.0), st.sampled_from([1e300, -1e300, 1.7e308, 5e-324]))
"""NaN and infinity among them."""


@settings(max_examples=25, deadline=None)
@given(hnp.arrays(float, BAD_UNTIL - GOOD, elements=ANY, fill=ANY), st.booleans())
@example(np.full(BAD_UNTIL - GOOD, 1e300), True)
@example(np.full(BAD_UNTIL - GOOD, 30.0), True)
@example(np.tile([1e300, -1e300], (BAD_UNTIL - GOOD) // 2), True)
@example(np.full(BAD_UNTIL - GOOD, 5.0), False)  # too near the true ones for a new beginning
def test_no_force_is_remembered_for_more_than_20_s(bad: np.ndarray, learned: bool) -> None:
    forces = CONTACT.f.copy()
    forces[GOOD:BAD_UNTIL] = bad
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
    assert dirty.renewals == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_contact_that_is_learned_is_never_forgotten(seed: int) -> None:
    sample, predictor = contact(60.0, RATE_HZ, seed, changed=3.0), Predictor()
    for n in range(DELAY, len(sample.t)):
        predictor.observe(sample.t[n - DELAY], sample.f[n - DELAY])
        predictor.move(sample.t[n], sample.x[n])
        predictor.predict()
    assert predictor.renewals == 0
