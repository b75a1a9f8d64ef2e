"""A contact of known parameters, moved by an operator, and what is learned of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

import numpy as np

from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import Motion
from forefeel.common.estimation.contact import Contact, ContactExpert, ContactFit
from forefeel.common.estimation.contact_model import Array
from forefeel.common.estimation.contact_prior import ContactPrior

DT_S = 0.004
TRUE = {
    "bias.force_n": 0.01,
    "presliding_hysteresis.force_n": 0.08,
    "presliding_hysteresis.length_m": 3.2e-4,
    "contact_loss.contact_position_m": 0.008,
    "mass_damper_spring.mass_kg": 0.01,
    "mass_damper_spring.damping_n_s_m": 0.4,
    "mass_damper_spring.stiffness_n_m": 7.5,
    "position_dependent_friction.force_per_length_n_m": 1.0,
    "position_dependent_friction.breakaway_m": 1e-4,
    "stress_relaxation.stiffness_n_m": 3.0,
    "stress_relaxation.time_constant_s": 0.6,
    "heart.amplitude_n": 0.012,
    "heart.frequency_hz": 1.17,
    "breath.amplitude_n": 0.015,
    "breath.frequency_hz": 0.23,
}


@dataclass(frozen=True, eq=False)
class Session:
    """Samples: shape (n,)."""

    t: Array
    x: Array
    v: Array
    a: Array
    force_n: Array


def session(duration_s: float, seed: int = 1, more: tuple[dict[str, object], ...] = ()) -> Session:
    """Rest for .5 s, then three sines in and out of contact; noise of 2 mN."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, duration_s, DT_S)
    on, x, v, a = np.maximum(t - 0.5, 0.0), np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
    for hz, size_m in ((0.21, 0.012), (0.47, 0.005), (0.9, 0.002)):
        w, phase = 2.0 * pi * hz, 0.3 * random.standard_normal()
        x += size_m * (np.cos(phase) - np.cos(w * on + phase))
        v += np.where(on > 0.0, size_m * w * np.sin(w * on + phase), 0.0)
        a += np.where(on > 0.0, size_m * w**2 * np.cos(w * on + phase), 0.0)
    force_n = world(*more).runtime().forces_n(Motion.of(t, x, v, a)) + 0.002 * random.standard_normal(len(t))
    return Session(t, x, v, a, force_n)


def world(*more: dict[str, object]) -> ContactModel:
    """The contact of `TRUE`, and more effects."""

    def effect(name: str, **parameters: float) -> dict[str, object]:
        given = {key.partition(".")[2]: v for key, v in TRUE.items() if key.startswith(name)}
        return {"effect": name, "parameters": {**given, **parameters}}

    hysteresis = {"force_n": 0.08, "stiffness_n_m": 0.08 / TRUE["presliding_hysteresis.length_m"]}
    return ContactModel.from_mapping(
        {
            "schema": "forefeel.model/1",
            "name": "known",
            "effects": [
                effect("contact_loss"),
                effect("bias"),
                {"effect": "presliding_hysteresis", "parameters": hysteresis},
                effect("mass_damper_spring"),
                effect("position_dependent_friction"),
                effect("stress_relaxation"),
                effect("pulsation", amplitude_n=0.012, frequency_hz=1.17),
                effect("pulsation", amplitude_n=0.015, frequency_hz=0.23, phase_rad=1.0),
                *more,
            ],
        }
    )


def samples(of: Session) -> Iterator[tuple[float, float, float, float, float]]:
    yield from zip(*(c.tolist() for c in (of.t, of.x, of.v, of.a, of.force_n)), strict=True)


def learned(of: Session, prior: ContactPrior | None = None) -> Contact | None:
    """What is known after the session's last sample."""
    fit = ContactFit(prior)
    for sample in samples(of):
        fit.observe(*sample)
        if (job := fit.due()) is not None:
            fit.apply(job.solve())
    return fit.contact


def predicted(
    of: Session, prior: ContactPrior | None = None, loaded: ContactModel | None = None, delay_s: float = 0.3
) -> Array:
    """The force at each sample when forces arrive after the delay and fits take what they take."""
    fit, expert, late = ContactFit(prior, loaded), ContactExpert(), round(delay_s / DT_S)
    rows, force_n, pending = list(samples(of)), np.full(len(of.t), np.nan), None
    if fit.contact is not None:
        expert.use(fit.contact)
    for i, (t_s, x, v, a, _) in enumerate(rows):
        if i >= late:
            arrived = rows[i - late]
            fit.observe(*arrived)
            if pending is not None and arrived[0] >= pending.takes_effect_s:
                fit.apply(pending.solve())
                pending = None
                if fit.contact is not None:
                    expert.use(fit.contact)
            pending = pending or fit.due()
        force_n[i] = expert.move(t_s, x, v, a, DT_S)
    return force_n
