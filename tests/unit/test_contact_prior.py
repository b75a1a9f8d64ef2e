"""A contact's prior: widening between sessions, what is no covariance."""

import pytest

from forefeel.common.estimation.contact_prior import CONTACT, ContactPrior, widened

SPRING = "mass_damper_spring.stiffness_n_m"


def prior(values: dict[str, float], deviation: float = 1.0, contact_s: float = 5.0) -> ContactPrior:
    names = tuple(values)
    rows = tuple(tuple(deviation**2 if a == b else 0.0 for a in names) for b in names)
    return ContactPrior(names, tuple(values.values()), rows, contact_s)


def test_widened_adds_spread_of_sessions() -> None:
    wide = widened(prior({SPRING: 10.0, CONTACT: 0.008}, 1e-9), 2.0)

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
