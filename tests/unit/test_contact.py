"""The contact model that is learned online: parameters, priors, order, a change in the loop."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from forefeel.common.estimation.contact import Contact, ContactExpert, ContactFit
from forefeel.common.estimation.contact_model import SHAPE, Causes, MotionExtent, typical_shape
from forefeel.common.estimation.contact_prior import CONTACT, ContactPrior, exactly, widened
from tests.unit.contact_samples import TRUE, Session, learned, predicted, samples, session

SPRING = "mass_damper_spring.stiffness_n_m"
FIRST, SECOND = session(14.0), session(14.0, seed=2)


def contact_of(of: Session) -> Contact:
    contact = learned(of)
    assert contact is not None
    return contact


@cache
def known() -> Contact:
    return contact_of(FIRST)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def test_fit_finds_parameters_within_their_standard_deviations() -> None:
    found = dict(zip(known().names, known().values, strict=True))
    deviations = dict(zip(known().names, known().standard_deviations, strict=True))
    off = [abs(found[name] - value) / deviations[name] for name, value in TRUE.items()]
    assert max(off) < 5.0
    assert np.median(off) < 2.0
    assert {name: found[name] for name in TRUE} == pytest.approx(TRUE, rel=0.15)
    assert found[CONTACT] == pytest.approx(TRUE[CONTACT], abs=1e-4)
    assert known().noise_n == pytest.approx(0.002, rel=0.2)
    assert known().contact_s == pytest.approx(np.count_nonzero(FIRST.x > 0.008) * 0.004, abs=2.0)


def test_fit_finds_stiffening_only_where_it_is() -> None:
    stiffening: dict[str, object] = {"effect": "stiffening", "parameters": {"quadratic_n_m2": 300.0}}
    curved = contact_of(session(14.0, more=(stiffening,)))
    assert not known().occasional
    assert dict(zip(known().names, known().values, strict=True))["stiffening.quadratic_n_m2"] == 0.0
    assert curved.occasional
    assert curved.noise_n == pytest.approx(0.002, rel=0.3)


def test_fit_of_passive_contact_has_no_negative_parameter() -> None:
    pulled = contact_of(replace(FIRST, force_n=-FIRST.force_n))

    found = dict(zip(pulled.names, pulled.values, strict=True))
    signed = {"bias.force_n", "stiffening.quadratic_n_m2", "stiffening.cubic_n_m3", CONTACT}
    assert all(value >= 0.0 for name, value in found.items() if name not in signed)


@pytest.mark.parametrize("size", [1e-12, 1e6])
def test_causes_accept_the_typical_shape_of_any_motion(size: float) -> None:
    shape, _ = typical_shape(MotionExtent(-size, size))
    assert Causes().model(shape, 0.0).runtime().linear_names == Causes().linear


def test_fit_at_rest_says_what_it_lacks() -> None:
    still = replace(FIRST, x=1e-5 * np.sin(FIRST.t), v=0.0 * FIRST.t, a=0.0 * FIRST.t)
    assert known().identifiable == ()
    assert any("mass_damper_spring" in text for text in contact_of(still).identifiable)


def test_prior_predicts_from_first_tick() -> None:
    force_n, early = SECOND.force_n, SECOND.t < 3.0
    warm, cold = predicted(SECOND, widened(known().prior(), 1.0)), predicted(SECOND)
    assert np.isfinite(warm).all()
    assert rms((warm - force_n)[early]) < 0.2 * rms((np.nan_to_num(cold) - force_n)[early])
    assert rms((warm - force_n)[~early]) < 0.006


def test_prior_of_a_file_may_have_a_length_of_zero() -> None:
    names = [name for name in SHAPE if name != CONTACT]
    belief = Causes().belief(exactly(dict.fromkeys(names, 0.0)))
    known = [name in names for name in SHAPE]
    assert np.isfinite(belief.shape[known]).all()
    assert (belief.shape_sd[known] > 0.0).all()


def test_prior_of_another_contact_is_given_up() -> None:
    trusted = known().prior()
    values = {
        name: value if "hz" in name else 0.1 * value
        for name, value in zip(trusted.names, trusted.values, strict=True)
    }
    rows = tuple(tuple(0.01 * value for value in row) for row in trusted.covariance)
    other = widened(replace(trusted, values=tuple(values.values()), covariance=rows), 1.0)
    left_n = (predicted(SECOND, other) - SECOND.force_n)[SECOND.t > 8.0]
    assert rms(left_n) < 0.01


def test_changed_contact_is_learned_anew() -> None:
    values = {"stiffness_n_m": 7.5, "time_s": 15.0, "ratio": 1.8, "rest_position_m": 0.0}
    moved = session(22.0, more=({"effect": "stiffness_change", "parameters": values},))
    left_n = predicted(moved) - moved.force_n
    assert rms(left_n[(moved.t > 15.5) & (moved.t < 16.0)]) > 0.03
    assert rms(left_n[moved.t > 19.0]) < 0.006


def test_late_and_doubled_samples_are_left_out() -> None:
    ordered = list(samples(FIRST))[:300]
    mixed = [late for i, sample in enumerate(ordered) for late in (sample, ordered[i // 2])]
    jobs = []
    for each in (ordered, mixed):
        fit = ContactFit()
        for sample in each:
            fit.observe(*sample)
        jobs.append(fit.due())
    one, other = jobs
    assert one is not None
    assert other is not None
    assert np.array_equal(one.samples, other.samples)


def test_use_keeps_memory_of_friction_and_relaxation() -> None:
    expert, rows = ContactExpert(), list(samples(FIRST))
    assert np.isnan(expert.move(0.0, 0.0, 0.0, 0.0, 0.001))
    expert.use(known())
    before = [expert.move(t, x, v, a, 0.004) for t, x, v, a, _ in rows][-1]
    expert.use(contact_of(session(4.0, seed=3)))
    expert.use(known())
    t, x, v, a, _ = rows[-1]
    assert expert.move(t, x, v, a, 0.0) == pytest.approx(before, rel=1e-9)


def test_widened_adds_spread_of_sessions() -> None:
    prior = ContactPrior((SPRING, CONTACT), (10.0, 0.008), ((1e-18, 0.0), (0.0, 1e-18)), 5.0)

    wide = widened(prior, 2.0)
    assert wide.values == (10.0, 0.008)
    assert wide.standard_deviations == pytest.approx((5.0, 0.004))


@pytest.mark.parametrize(
    ("names", "values", "covariance"),
    [
        (("a", "a"), (1.0, 2.0), ((1.0, 0.0), (0.0, 1.0))),
        (("a",), (1.0, 2.0), ((1.0,),)),
        (("a", "b"), (1.0, 2.0), ((1.0, 2.0), (2.0, 1.0))),
        (("a", "b"), (1.0, 2.0), ((1.0, 0.5), (0.0, 1.0))),
        (("a",), (1.0,), ((0.0,),)),
        (("a",), (float("nan"),), ((1.0,),)),
        (("a",), (1.0,), ((float("inf"),),)),
    ],
)
def test_prior_of_no_covariance_is_refused(
    names: tuple[str, ...], values: tuple[float, ...], covariance: tuple[tuple[float, ...], ...]
) -> None:
    with pytest.raises(ValueError, match="expected"):
        ContactPrior(names, values, covariance, 1.0)
