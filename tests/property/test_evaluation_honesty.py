"""A prediction at t depends on the motion up to t and the forces stamped up to t - delay: on nothing else.

Of the predictor itself tests/property/test_predictor_honesty.py says so, of each of its experts.
"""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from forefeel.diagnosis.evaluation.methods import METHODS, MethodTrace, replay
from tests.unit.evaluation_samples import made_up, recording

LINKS = [DelayedLink(0.3), DelayedLink(0.3, jitter_s=0.05, loss=0.05, seed=7)]
SAMPLE = made_up(duration_s=5.0)


def said(of: Recording, link: DelayedLink, method: str) -> MethodTrace:
    return replay(of, arrivals(of.time_s, link), METHODS[method](None))


@cache
def original(method: str, link: DelayedLink) -> MethodTrace:
    return said(SAMPLE, link, method)


def altered(cut: int, delay_s: float, seed: int) -> Recording:
    """All forces stamped after t - delay and all motion after t are others, and far off."""
    assert SAMPLE.force_n is not None
    rng = np.random.default_rng(seed)
    t = SAMPLE.time_s[cut]
    late, ahead = SAMPLE.time_s > t - delay_s, SAMPLE.time_s > t
    force_n = SAMPLE.force_n + late * rng.normal(0, 50.0, len(SAMPLE))
    position_m = SAMPLE.position_m + ahead * rng.normal(0, 0.05, len(SAMPLE))
    return recording(SAMPLE.time_s, position_m, force_n)


def differences(one: MethodTrace, other: MethodTrace, rows: slice) -> int:
    """At how many stamps the two differ, in whatever they say."""
    columns = zip(
        (one.answered, one.force_n, one.low_n, one.high_n),
        (other.answered, other.force_n, other.low_n, other.high_n),
        strict=True,
    )
    unlike = np.zeros(len(one.answered), dtype=np.bool_)
    for a, b in columns:
        unlike |= ~((a == b) | (np.isnan(a) & np.isnan(b)))
    unlike |= np.array([a != b for a, b in zip(one.leading, other.leading, strict=True)])
    return int(np.count_nonzero(unlike[rows]))


@pytest.mark.parametrize("link", LINKS, ids=str)
@pytest.mark.parametrize("method", [name for name in METHODS if name != "forefeel"])
@settings(max_examples=5)
@given(cut=st.integers(50, len(SAMPLE) - 50), seed=st.integers(0, 99))
def test_what_was_not_known_changes_nothing(method: str, link: DelayedLink, cut: int, seed: int) -> None:
    other = said(altered(cut, link.delay_s - link.jitter_s, seed), link, method)
    assert differences(original(method, link), other, slice(0, cut + 1)) == 0


@pytest.mark.parametrize("method", METHODS)
def test_what_is_known_later_does_change_what_is_said_later(method: str) -> None:
    """Without this the test above could compare predictions that depend on nothing."""
    link, cut = LINKS[0], 300
    other = said(altered(cut, link.delay_s, seed=3), link, method)
    assert differences(original(method, link), other, slice(cut + 1, None)) > 100
