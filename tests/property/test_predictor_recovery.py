"""Whatever forces and stamps the predictor was given, in whatever order, it predicts well again 5 s later."""

from collections.abc import Callable

import numpy as np
import pytest

from forefeel.common.estimation.predictor import Predictor
from tests.unit.predictor_samples import Array, Sample, contact

RATE_HZ, DELAY = 100, 20  # samples: 0.2 s
GOOD, BAD_UNTIL, WELL = 400, 600, 1100  # well: 5 s after the last bad sample
CONTACT = contact(14.0, RATE_HZ)
COUNT = BAD_UNTIL - GOOD


def forces(bad: Array) -> Callable[[], Sample]:
    def sample() -> Sample:
        f = CONTACT.f.copy()
        f[GOOD : GOOD + len(bad)] = bad
        return Sample(CONTACT.t, CONTACT.x, f)

    return sample


def stamps(steps_s: float) -> Callable[[], Sample]:
    """Steps of that length; the motion goes on as if they were usual ones, and the clock comes back."""

    def sample() -> Sample:
        t = CONTACT.t.copy()
        t[GOOD:BAD_UNTIL] = t[GOOD] + steps_s * np.arange(COUNT)
        t[BAD_UNTIL:] += max(0.0, t[BAD_UNTIL - 1] - t[BAD_UNTIL] + 0.01)
        return Sample(t, CONTACT.x, CONTACT.f)

    return sample


BAD = {
    "100 of 1e300": forces(np.full(100, 1e300)),
    "either end": forces(np.tile([1e300, -1e300], COUNT // 2)),
    "30 N": forces(np.full(COUNT, 30.0)),
    "jumps": forces(np.tile([50.0, -60.0], COUNT // 2)),
    "steps of 1e-12 s": stamps(1e-12),
    "gaps of 20 s": stamps(20.0),
}


@pytest.mark.parametrize(
    ("bad", "begin", "share"),
    [*((bad, 0, 0.5) for bad in BAD), ("100 of 1e300", GOOD, 0.5), ("30 N", GOOD, 0.7), ("jumps", GOOD, 1.0)],
)
def test_nothing_bad_is_remembered_for_more_than_5_s(bad: str, begin: int, share: float) -> None:
    """The bad ones come after good ones, or first. Jumps of a hundred times all later forces take longer."""
    given, predictor = BAD[bad](), Predictor()
    said = np.full(len(given.t), np.nan)
    low_n, high_n = given.f.min(), given.f.max()
    for n in range(begin, len(given.t)):
        if n >= DELAY + begin:
            predictor.observe(given.t[n - DELAY], given.f[n - DELAY])
        predictor.move(given.t[n], given.x[n])
        estimate = predictor.predict()
        if estimate is not None:
            assert np.isfinite(estimate[:3]).all()
            said[n] = estimate.force_n
    spoken = said[np.isfinite(said)]
    assert len(spoken) >= len(given.t) - begin - DELAY - 3
    assert low_n - (high_n - low_n) <= spoken.min() <= spoken.max() <= high_n + (high_n - low_n)
    error = said[WELL:] - CONTACT.f[WELL:]
    held = CONTACT.f[WELL - DELAY : -DELAY] - CONTACT.f[WELL:]
    assert np.sqrt(np.mean(error**2)) < share * np.sqrt(np.mean(held**2))


def test_what_is_no_number_is_left_out() -> None:
    clean, dirty = Predictor(), Predictor()
    for n in range(DELAY, 600):
        for each in (clean, dirty):
            each.observe(CONTACT.t[n - DELAY], CONTACT.f[n - DELAY])
            each.move(CONTACT.t[n], CONTACT.x[n])
        for odd in (np.nan, np.inf, -np.inf):
            dirty.observe(CONTACT.t[n - DELAY], odd)
            dirty.move(CONTACT.t[n] + 0.1 / RATE_HZ, odd)
        assert dirty.predict() == clean.predict()
    said = clean.predict()
    assert said is not None
    assert said.leading != "zoh"
    assert dirty.learner.renewals == 0


def test_a_contact_that_is_learned_is_never_forgotten() -> None:
    sample, predictor = contact(30.0, RATE_HZ, changed=3.0), Predictor()
    for n in range(DELAY, len(sample.t)):
        predictor.observe(sample.t[n - DELAY], sample.f[n - DELAY])
        predictor.move(sample.t[n], sample.x[n])
        predictor.predict()
    assert predictor.learner.renewals == 0
