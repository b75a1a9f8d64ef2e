"""A prediction depends on the motion up to now and the forces that have arrived, to the bit.

Checked for the force, its band, the name that leads, and what every single expert says.
"""

from dataclasses import dataclass

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.estimation.blend import NAMES
from forefeel.common.estimation.predictor import Predictor
from tests.unit.predictor_samples import Array, contact

SAMPLE = contact(duration_s=6.0, rate_hz=200.0, changed=2.0)
COUNT = len(SAMPLE.t)
MODEL = ContactModel.from_mapping(
    {"schema": SCHEMA, "name": "k", "effects": [{"effect": "mass_damper_spring"}]}
)


@dataclass(frozen=True)
class Everything:
    """(n, 3) of force and band, (n, experts) of what each said, n names."""

    said: Array
    experts: Array
    leading: tuple[str, ...]


def everything(x: Array, f: Array, delay: int) -> Everything:
    predictor = Predictor(MODEL)
    said, experts = np.full((COUNT, 3), np.nan), np.full((COUNT, len(NAMES)), np.nan)
    leading = [""] * COUNT
    for n in range(COUNT):
        if n >= delay:
            predictor.observe(SAMPLE.t[n - delay], f[n - delay])
        predictor.move(SAMPLE.t[n], x[n])
        if (estimate := predictor.predict()) is not None:
            said[n], leading[n] = estimate[:3], estimate.leading
        experts[n] = predictor._evaluator.record[0]["said_n"][n]
    return Everything(said, experts, tuple(leading))


DELAYS = (4, 60, 200)
ORIGINALS = {delay: everything(SAMPLE.x, SAMPLE.f, delay) for delay in DELAYS}


def same(one: Array, other: Array) -> NDArray[np.bool_]:
    """Row by row, NaN being itself."""
    return np.asarray(((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=1))


@settings(max_examples=20)
@given(
    delay=st.sampled_from(DELAYS),
    now=st.integers(0, COUNT - 1),
    seed=st.integers(0, 2**16),
    size=st.sampled_from([1e-9, 1.0, 1e6, np.nan]),
)
def test_what_was_not_known_changes_no_bit(delay: int, now: int, seed: int, size: float) -> None:
    noise = size * np.random.default_rng(seed).standard_normal((2, COUNT))
    n = np.arange(COUNT)
    f = np.where(n > now - delay, SAMPLE.f + noise[0], SAMPLE.f)
    x = np.where(n > now, SAMPLE.x + noise[1], SAMPLE.x)
    original, altered = ORIGINALS[delay], everything(x, f, delay)
    upto = slice(0, now + 1)
    assert same(original.said, altered.said)[upto].all()
    assert same(original.experts, altered.experts)[upto].all()
    assert original.leading[upto] == altered.leading[upto]


def test_what_has_arrived_does_change_what_is_said() -> None:
    altered = everything(SAMPLE.x, np.where(np.arange(COUNT) >= 600, 2.0, 1.0) * SAMPLE.f, 60)
    differs = ~same(ORIGINALS[60].said, altered.said)
    assert not differs[:660].any()
    assert differs[660:].mean() > 0.9


def test_every_expert_speaks_and_several_lead() -> None:
    spoken = np.isfinite(ORIGINALS[60].experts).any(axis=0)
    assert [NAMES[e] for e in np.flatnonzero(spoken)] == list(NAMES)
    assert len(set(ORIGINALS[60].leading)) > 2
