"""A model of a diagnosis in the contact model: which causes join, what is known, what it is worth."""

import numpy as np
import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.contact import ContactFit
from forefeel.common.estimation.contact_loaded import loaded_causes
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.predictor import Predictor
from tests.unit.contact_samples import predicted, session, world


def model(*effects: tuple[str, dict[str, float]], site: str | None = None) -> ContactModel:
    entries: list[dict[str, object]] = [{"effect": name, "parameters": values} for name, values in effects]
    if site is not None:
        entries[-1]["site"] = site
    return ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "found", "effects": entries})


def test_shared_cause_gives_means() -> None:
    found = loaded_causes(
        model(
            ("bias", {"force_n": 0.3}),
            ("mass_damper_spring", {"mass_kg": 0.0, "damping_n_s_m": 0.5, "stiffness_n_m": 12.0}),
            ("presliding_hysteresis", {"force_n": 0.1, "stiffness_n_m": 50.0}),
            ("pulsation", {"amplitude_n": 0.02, "frequency_hz": 1.1, "second_harmonic_ratio": 0.5}),
        )
    )

    assert found.further == ()
    assert found.means == pytest.approx(
        {
            "mass_damper_spring.damping_n_s_m": 0.5,
            "mass_damper_spring.stiffness_n_m": 12.0,
            "presliding_hysteresis.force_n": 0.1,
            "presliding_hysteresis.length_m": 0.002,
            "heart.frequency_hz": 1.1,
            "heart.amplitude_n": 0.02,
            "heart.second_harmonic_n": 0.01,
        }
    )


def test_a_heart_whose_rate_varies_gives_its_mean_rate() -> None:
    heart = {"amplitude_n": 0.02, "frequency_hz": 1.1, "rate_variation": 0.05}
    found = loaded_causes(model(("varying_pulsation", heart), ("varying_pulsation", heart)))
    assert found.means == {"heart.frequency_hz": 1.1, "heart.amplitude_n": 0.02}
    assert [entry.effect for entry in found.further] == ["pulsation", "pulsation"]


def test_further_cause_joins_by_its_name_in_the_list() -> None:
    loaded = model(
        ("backlash", {"width_m": 0.002}),
        ("stress_relaxation", {"stiffness_n_m": 2.0, "time_constant_s": 0.5}),
        ("stress_relaxation", {"stiffness_n_m": 3.0, "time_constant_s": 5.0}),
        ("mains_hum", {"amplitude_n": 0.02, "frequency_hz": 50.0}),
        ("sensor_spikes", {"rate_hz": 1.0, "amplitude_n": 0.5}),
        ("bias", {"force_n": 0.3}),
        site="wall",
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


def test_prior_goes_before_loaded_model() -> None:
    name = "mass_damper_spring.stiffness_n_m"
    prior = ContactPrior((name,), (9.0,), ((0.01,),), 10.0)
    values = {"mass_kg": 0.01, "damping_n_s_m": 0.5, "stiffness_n_m": 12.0}
    contact = ContactFit(prior, model(("mass_damper_spring", values))).contact

    assert contact is not None
    known = dict(zip(contact.names, contact.values, strict=True))
    assert known[name] == 9.0
    assert known["mass_damper_spring.damping_n_s_m"] == 0.5


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("backlash", {"width_m": 0.002}),
        ("quadratic_drag", {"drag_n_s2_m2": 120.0}),
        ("capstan", {"wrap_rad": 0.4}),
        ("sensor_lag", {"time_constant_s": 0.08}),
    ],
)
def test_loaded_cause_predicts_what_the_list_lacks(name: str, values: dict[str, float]) -> None:
    effect: dict[str, object] = {"effect": name, "parameters": values}
    moved = session(7.0, more=(effect,))
    error = predicted(moved, loaded=world(effect)) - moved.force_n

    assert np.sqrt(np.mean(error[moved.t > 4.0] ** 2)) < 0.006


def test_wrong_model_is_dropped_and_what_the_experts_have_learned_stays() -> None:
    """A spring of 500 times the stiffness, with friction, in place of a spring."""
    spring = {"mass_kg": 0.0, "damping_n_s_m": 0.0, "stiffness_n_m": 5e4}
    friction = {"force_n": 20.0, "stiffness_n_m": 1e5}
    alone = Predictor()
    beside = Predictor(model(("mass_damper_spring", spring), ("presliding_hysteresis", friction)))
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
    assert beside.learner._model is None and beside.learner.renewals == 0
    assert errors_n[1] < 1.02 * errors_n[0]
