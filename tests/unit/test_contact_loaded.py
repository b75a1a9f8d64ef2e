"""A model of a diagnosis in the contact model: which causes join, what is known, what it is worth."""

import numpy as np
import pytest

from forefeel.common.estimation.contact import ContactFit
from forefeel.common.estimation.contact_loaded import loaded_causes
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.predictor import Predictor
from tests.unit.contact_samples import predicted, session, world
from tests.unit.model_samples import effect, model


def test_shared_cause_gives_means() -> None:
    """A heart whose rate varies gives its mean rate."""
    effects = (
        effect("bias", force_n=0.3),
        effect("mass_damper_spring", mass_kg=0.0, damping_n_s_m=0.5, stiffness_n_m=12.0),
        effect("presliding_hysteresis", force_n=0.1, stiffness_n_m=50.0),
    )
    beats = {"amplitude_n": 0.02, "frequency_hz": 1.1}
    means = {
        "mass_damper_spring.damping_n_s_m": 0.5, "mass_damper_spring.stiffness_n_m": 12.0,
        "presliding_hysteresis.force_n": 0.1, "presliding_hysteresis.length_m": 0.002,
        "heart.frequency_hz": 1.1, "heart.amplitude_n": 0.02,
    }  # fmt: skip
    even = loaded_causes(model(*effects, effect("pulsation", second_harmonic_ratio=0.5, **beats)))
    heart = effect("varying_pulsation", rate_variation=0.05, **beats)
    varying = loaded_causes(model(*effects, heart, heart))
    assert even.further == ()
    assert even.means == pytest.approx({**means, "heart.second_harmonic_n": 0.01})
    assert varying.means == pytest.approx(means)
    assert [entry.effect for entry in varying.further] == ["pulsation", "pulsation"]


def test_further_cause_joins_by_its_name_in_the_list() -> None:
    loaded = model(
        effect("backlash", width_m=0.002),
        effect("stress_relaxation", stiffness_n_m=2.0, time_constant_s=0.5),
        effect("stress_relaxation", stiffness_n_m=3.0, time_constant_s=5.0),
        effect("mains_hum", amplitude_n=0.02, frequency_hz=50.0),
        effect("sensor_spikes", rate_hz=1.0, amplitude_n=0.5),
        effect("bias", "wall", force_n=0.3),
    )
    found = loaded_causes(loaded)

    further = ["backlash", "stress_relaxation", "mains_hum", "mains_hum", "bias"]
    assert [entry.effect for entry in found.further] == further
    assert found.means["stress_relaxation.time_constant_s"] == 0.5
    assert found.means["stress_relaxation-2.stiffness_n_m"] == 3.0
    assert found.means["bias-2.force_n"] == 0.3
    contact = ContactFit(loaded=loaded).contact
    assert contact is not None
    assert set(found.means) <= set(contact.model.runtime().linear_names) | set(contact.names)


def test_harmonics_beyond_the_frequencies_of_their_cause_are_left_out() -> None:
    hum = effect("mains_hum", frequency_hz=50.0, amplitude_n=0.05, second_harmonic_ratio=0.3)
    fast = {"second_harmonic_ratio": 0.3, "third_harmonic_ratio": 0.3}
    loaded = model(hum, effect("pulsation", frequency_hz=18.0, amplitude_n=0.05, **fast))
    frequencies = [dict(entry.parameters)["frequency_hz"] for entry in loaded_causes(loaded).further]
    assert frequencies == [50.0, 50.0, 18.0, 18.0, 36.0, 36.0]


def test_prior_goes_before_loaded_model() -> None:
    name = "mass_damper_spring.stiffness_n_m"
    prior = ContactPrior((name,), (9.0,), ((0.01,),), 10.0)
    values = {"mass_kg": 0.01, "damping_n_s_m": 0.5, "stiffness_n_m": 12.0}
    contact = ContactFit(prior, model(effect("mass_damper_spring", **values))).contact
    assert contact is not None
    known = dict(zip(contact.names, contact.values, strict=True))
    assert known[name] == 9.0
    assert known["mass_damper_spring.damping_n_s_m"] == 0.5


@pytest.mark.parametrize(
    "cause",
    [
        effect("backlash", width_m=0.002),
        effect("quadratic_drag", drag_n_s2_m2=120.0),
        effect("capstan", wrap_rad=0.4),
        effect("sensor_lag", time_constant_s=0.08),
    ],
    ids=lambda cause: cause["effect"],
)
def test_loaded_cause_predicts_what_the_list_lacks(cause: dict[str, object]) -> None:
    moved = session(7.0, more=(cause,))
    error = predicted(moved, loaded=world(cause)) - moved.force_n
    assert np.sqrt(np.mean(error[moved.t > 4.0] ** 2)) < 0.006


@pytest.mark.parametrize(
    "cause",
    [
        effect("capstan", wrap_rad=10.0, wrap_rad_m=1e5),
        effect("presliding_hysteresis", force_n=1e-6, stiffness_n_m=1e-6),
        effect("presliding_hysteresis", force_n=1e4, stiffness_n_m=1e12),
    ],
    ids=["capstan, most", "presliding, least", "presliding, most"],
)
def test_cause_at_its_bounds_ends_no_fit(cause: dict[str, object]) -> None:
    predictor = Predictor(model(cause))
    t = 0.004 * np.arange(325)
    for t_s, x_m in zip(t.tolist(), (0.01 * np.sin(4.4 * t)).tolist(), strict=True):
        predictor.move(t_s, x_m)
        predictor.observe(t_s, 200.0 * max(x_m, 0.0))
    estimate = predictor.predict()
    assert estimate is not None and np.isfinite(estimate.force_n)


def test_wrong_model_is_dropped_and_what_the_experts_have_learned_stays() -> None:
    """A spring of 500 times the stiffness, with friction, in place of a spring."""
    spring = {"mass_kg": 0.0, "damping_n_s_m": 0.0, "stiffness_n_m": 5e4}
    friction = {"force_n": 20.0, "stiffness_n_m": 1e5}
    alone = Predictor()
    beside = Predictor(
        model(effect("mass_damper_spring", **spring), effect("presliding_hysteresis", **friction))
    )
    t = 0.004 * np.arange(2000)
    x = 0.005 * (1.0 - np.cos(4.0 * t)) + 0.002 * np.sin(7.0 * t)
    errors_n = []
    for predictor in (alone, beside):
        predicted_n = np.zeros(len(t))
        for n, (t_s, x_m) in enumerate(zip(t.tolist(), x.tolist(), strict=True)):
            if n >= 75:
                predictor.observe(float(t[n - 75]), 100.0 * float(x[n - 75]))
            predictor.move(t_s, x_m)
            estimate = predictor.predict()
            predicted_n[n] = estimate.force_n if estimate else 0.0
        errors_n.append(np.sqrt(np.mean((predicted_n - 100.0 * x)[1250:] ** 2)))
    assert beside.learner.model is None and beside.learner.renewals == 0
    assert errors_n[1] < 1.02 * errors_n[0]
