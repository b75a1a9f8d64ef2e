"""A prediction depends on the motion up to now and the forces that have arrived, to the bit.

Checked for the force, its band, the name that leads, and what every single expert has said of each sample, as
it stands where it is judged by the force that comes later; cold, with a model and with a prior.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from forefeel.common.estimation.blend import CONTACT, NAMES
from forefeel.common.estimation.contact_prior import exactly, widened
from forefeel.common.estimation.predictor import Predictor
from tests.unit.model_samples import effect, model
from tests.unit.predictor_samples import Array, contact

SAMPLE = contact(duration_s=5.0, rate_hz=200.0, changed=2.0)
COUNT = len(SAMPLE.t)
PRIOR = widened(
    exactly({"mass_damper_spring.stiffness_n_m": 60.0, "mass_damper_spring.damping_n_s_m": 1.5}), 1.0
)
MODEL = model(effect("mass_damper_spring"))
KNOWN = {"cold": (None, None), "model": (MODEL, None), "prior": (None, PRIOR), "both": (MODEL, PRIOR)}
DELAYS = (4, 60, 200)


@dataclass(frozen=True)
class Everything:
    """(n, 3) of force and band, (n, experts) of what each has said, n names."""

    said: Array
    experts: Array
    leading: tuple[str, ...]


def everything(x: Array, f: Array, delay: int, known: str) -> Everything:
    predictor = Predictor(*KNOWN[known])
    said, leading = np.full((COUNT, 3), np.nan), [""] * COUNT
    for n in range(COUNT):
        if n >= delay:
            predictor.observe(SAMPLE.t[n - delay], f[n - delay])
        predictor.move(SAMPLE.t[n], x[n])
        if (estimate := predictor.predict()) is not None:
            said[n], leading[n] = estimate[:3], estimate.leading
    # read when every force has come: what an expert is judged by is what it said before
    return Everything(said, predictor._evaluator.record.values["members_n"][:COUNT].copy(), tuple(leading))


@cache
def original(known: str, delay: int) -> Everything:
    """Of the sample as it is."""
    return everything(SAMPLE.x, SAMPLE.f, delay, known)


def same(one: Array, other: Array) -> NDArray[np.bool_]:
    """Row by row, NaN being itself."""
    return np.asarray(((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=1))


@pytest.mark.parametrize("known", KNOWN)
@settings(max_examples=5)
@given(
    delay=st.sampled_from(DELAYS),
    now=st.integers(100, COUNT - 100),
    seed=st.integers(0, 2**16),
    size=st.sampled_from([1e-9, 1.0, 1e6, np.nan]),
)
def test_what_was_not_known_changes_no_bit(known: str, delay: int, now: int, seed: int, size: float) -> None:
    noise = size * np.random.default_rng(seed).standard_normal((2, COUNT))
    n = np.arange(COUNT)
    f = np.where(n > now - delay, SAMPLE.f + noise[0], SAMPLE.f)
    x = np.where(n > now, SAMPLE.x + 1e-3 * noise[1], SAMPLE.x)
    before, altered = original(known, delay), everything(x, f, delay, known)
    upto = slice(0, now + 1)
    assert same(before.said, altered.said)[upto].all()
    assert same(before.experts, altered.experts)[upto].all()
    assert before.leading[upto] == altered.leading[upto]


@pytest.mark.parametrize("known", KNOWN)
def test_what_has_arrived_does_change_what_is_said(known: str) -> None:
    before, delay, changed = original(known, 60), 60, 600
    forces_n = np.where(np.arange(COUNT) >= changed, 2.0, 1.0) * SAMPLE.f
    altered = everything(SAMPLE.x, forces_n, delay, known)
    differs = ~same(before.said, altered.said)
    assert not differs[: changed + delay].any()
    assert differs[changed + delay :].mean() > 0.9
    experts = (before.experts != altered.experts)[changed + delay + 200 :]
    assert (experts.mean(axis=0) > 0.9).all()


def test_every_expert_speaks_and_several_lead() -> None:
    spoken = np.isfinite(original("cold", 60).experts).any(axis=0)
    assert [NAMES[e] for e in np.flatnonzero(spoken)] == list(NAMES)
    assert len(set(original("cold", 60).leading)) > 2
    assert np.isfinite(original("prior", 60).experts[100, CONTACT:]).all()
