"""Merging priors by their information, whatever they know."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.estimation.contact_prior import ContactPrior, merged

NAMES = "a_n", "b_n_m", "c_m"


@st.composite
def priors(draw: st.DrawFn) -> ContactPrior:
    """Up to three parameters of sizes 1e-6 to 1e6, correlated."""
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, unique=True))
    n = len(names)
    size = 10.0 ** np.array(draw(st.lists(st.floats(-6.0, 6.0), min_size=n, max_size=n)))
    numbers = st.floats(-1.0, 1.0)
    mixed = np.array(draw(st.lists(numbers, min_size=n * n, max_size=n * n))).reshape(n, n)
    covariance = (mixed @ mixed.T + 0.01 * np.eye(n)) * np.outer(size, size)
    values = size * np.array(draw(st.lists(numbers, min_size=n, max_size=n)))
    return ContactPrior(tuple(names), tuple(values.tolist()), tuple(map(tuple, covariance.tolist())), 1.0)


@given(priors(), priors())
def test_merged_is_surer_than_either_in_any_order(first: ContactPrior, second: ContactPrior) -> None:
    both, turned = merged(first, second), merged(second, first)
    deviation = dict(zip(both.names, both.standard_deviations, strict=True))
    for prior in (first, second):
        for name, alone in zip(prior.names, prior.standard_deviations, strict=True):
            assert deviation[name] <= alone * (1.0 + 1e-6)
    values = dict(zip(turned.names, turned.values, strict=True))
    for name, value in zip(both.names, both.values, strict=True):
        assert values[name] == pytest.approx(value, rel=1e-4, abs=1e-4 * deviation[name])
