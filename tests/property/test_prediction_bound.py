"""No prediction runs away, at any rate, delay, rest before the motion and noise; cold, with the right model
or a wrong prior. A model that is ten times off is felt until the first force of a push has come.
"""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import Motion
from forefeel.common.estimation.contact_prior import ContactPrior, exactly, widened
from forefeel.slave.plant.presets import PRESETS
from tests.unit.model_samples import effect, model
from tests.unit.predictor_samples import Sample, replayed

WORLDS = {
    "vessel": model(
        effect("mass_damper_spring", mass_kg=0.01, stiffness_n_m=7.5),
        effect("presliding_hysteresis", force_n=0.08, stiffness_n_m=250.0),
        effect("asymmetric_damping", forward_n_s_m=6.0, backward_n_s_m=0.5),
    ),
    **{name: ContactModel.from_mapping(preset["contact"]) for name, preset in PRESETS.items()},
}


def moved(world: str, rate_hz: float, rest_s: float, creep_m_s: float, seed: int) -> Sample:
    """A rest, a creep of half a second, then strokes of random depth and speed for 6 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(round((rest_s + 6.5) * rate_hz)) / rate_hz
    turns_s = np.cumsum([rest_s, 0.5, *rng.uniform(0.15, 1.2, 40)])
    turns_m = np.array([0.0, 0.5 * creep_m_s, *rng.uniform(0.0, 0.04, 40)])
    start = np.minimum(np.searchsorted(turns_s, t, "right"), len(turns_s) - 1)
    before_s, before_m = turns_s[start - 1], turns_m[start - 1]
    share = np.clip((t - before_s) / (turns_s[start] - before_s), 0.0, 1.0)
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    x = np.where(t < rest_s, 0.0, before_m + (turns_m[start] - before_m) * smooth)
    v = np.gradient(x, t)
    f = WORLDS[world].runtime().forces_n(Motion.of(t, x, v, np.gradient(v, t)))
    noise_n = rng.uniform(0.002, 0.02) * f.std()
    return Sample(t, np.round(x / 1e-6) * 1e-6, f + rng.normal(0.0, noise_n, len(t)))


def taught(known: str, world: str) -> tuple[ContactModel | None, ContactPrior | None]:
    """Model and prior, whose spring has a third of the catheter's stiffness, 5 times the guidewire's."""
    prior = widened(exactly({"mass_damper_spring.stiffness_n_m": 2.5}), 1.0)
    return WORLDS[world] if known == "model" else None, prior if known == "prior" else None


@settings(max_examples=8)
@example(500.0, 0.3, 3.2, 1e-5, "vessel", "model", 4)
@given(
    rate_hz=st.sampled_from([50.0, 77.0, 100.0, 217.0, 333.0, 500.0, 1000.0]),
    delay_s=st.sampled_from([0.02, 0.12, 0.3, 0.6]),
    rest_s=st.floats(0.0, 4.0),
    creep_m_s=st.floats(0.0, 1e-3),
    world=st.sampled_from(sorted(WORLDS)),
    known=st.sampled_from(["nothing", "model", "prior"]),
    seed=st.integers(0, 1000),
)
def test_no_prediction_runs_away(
    rate_hz: float, delay_s: float, rest_s: float, creep_m_s: float, world: str, known: str, seed: int
) -> None:
    sample = moved(world, rate_hz, rest_s, creep_m_s, seed)
    taught_model, prior = taught(known, world)
    said = replayed(sample, delay_s, prior=prior, model=taught_model)
    rows = np.isfinite(said.held) & np.isfinite(said.force)
    assert np.abs(said.force[rows]).max() <= 3.0 * np.abs(sample.f).max()
    assert said.rms(sample.f, rows) <= 1.2 * said.zoh_rms(sample.f, rows)
