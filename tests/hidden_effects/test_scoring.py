"""The harness itself: what counts as right, what is counted, what is missed."""

from functools import partial
from typing import Any

import pytest

from tests.hidden_effects.answers import NAMING, Answer, Interval
from tests.hidden_effects.cases import Case
from tests.hidden_effects.equivalences import comparable, right_first, same_names
from tests.hidden_effects.generator import Hidden, Truth, draw
from tests.hidden_effects.score import Outcome, scored
from tests.hidden_effects.tables import all_rates, unmet

_SHORT: dict[str, Any] = {"longest_s": 14.0, "fastest_hz": 300.0}


def _friction(label: str) -> Truth:
    drawn = (draw("coulomb_friction", seed, **_SHORT).truth for seed in range(20))
    return next(truth for truth in drawn if truth.labels == (label,))


def test_only_an_asymmetric_friction_may_be_friction_and_bias() -> None:
    both = ("coulomb_friction", "bias")
    assert same_names(_friction("asymmetric"), both)
    assert same_names(_friction("asymmetric"), both[:1])
    assert not same_names(_friction("symmetric"), both)
    assert right_first(_friction("asymmetric"), ("bias", "coulomb_friction"))
    assert not right_first(_friction("symmetric"), ("bias", "coulomb_friction"))
    assert not right_first(_friction("symmetric"), ())


def test_notations_of_friction_and_damping() -> None:
    levels: dict[str, Interval] = {"forward_n": (0.3, 0.28, 0.32), "backward_n": (0.1, 0.08, 0.12)}
    answer = Answer("cause_found", ("coulomb_friction",), {"coulomb_friction": levels})
    assert comparable(answer, "coulomb_friction")["force_n"][0] == pytest.approx(0.2)
    split = Answer(
        "cause_found",
        ("coulomb_friction", "bias"),
        {"coulomb_friction": {"force_n": (0.2, 0.19, 0.21)}, "bias": {"force_n": (0.1, 0.09, 0.11)}},
    )
    found = comparable(split, "coulomb_friction")
    assert (found["forward_n"][0], found["backward_n"][0]) == pytest.approx((0.3, 0.1))
    slopes: dict[str, Interval] = {"forward_n_s_m": (3.0, 2.9, 3.1), "backward_n_s_m": (1.0, 0.9, 1.1)}
    damped = comparable(Answer("cause_found", (), {"asymmetric_damping": slopes}), "asymmetric_damping")
    assert damped["difference_n_s_m"][0] == pytest.approx(2.0)
    assert damped["difference_n_s_m"][1] == pytest.approx(2.0 - 0.1 * 2**0.5)


def _told(factor: float, verdict: str, hidden: Hidden) -> Answer:
    """What a method would say that knows the truth, its parameters off by a factor."""
    parameters = {
        effect: {name: (factor * v, v - abs(v) * 0.01, v + abs(v) * 0.01) for name, v in given.items()}
        for effect, given in hidden.truth.parameters.items()
    }
    return Answer(verdict, hidden.truth.names, parameters, gain_low=0.1, seconds=0.5)


def _said(verdict: str, hidden: Hidden) -> Answer:
    return Answer(verdict)


_CASES = [
    Case("single", "quadratic_drag", 1, **_SHORT),
    Case("quarter", "stiffening", 1, 0.25, **_SHORT),
    Case("pair", "bias+sensor_drift", 1, **_SHORT),
]
_SILENT = [
    Case("nothing", "nothing", 1, **_SHORT),
    Case("outside", "chirp", 1, **_SHORT),
    Case("pure_sine", "pure_sine", 1, **_SHORT),
    Case("constant_speed", "constant_speed", 1, **_SHORT),
    Case("standstill", "standstill", 1, **_SHORT),
]
_NAMED = (*NAMING, "cause_found")
_DEMANDED = ("nothing_missing", "unexplained", "not_separable", "not_separable", "refused")


def _all(factor: float = 1.0, verdicts: tuple[str, ...] = _DEMANDED) -> list[Outcome]:
    named = [
        scored(case, partial(_told, factor, verdict)) for case, verdict in zip(_CASES, _NAMED, strict=True)
    ]
    pairs = zip(_SILENT, verdicts, strict=True)
    return named + [scored(case, partial(_said, verdict)) for case, verdict in pairs]


def test_parameters_that_are_off_are_counted() -> None:
    close, _, _, covered = all_rates(_all(1.2))[-4:]
    assert close.hits == 0 < close.total
    assert covered.hits == covered.total
    assert not close.met


def test_wrong_verdicts_are_counted() -> None:
    verdicts = ("cause_found", "nothing_missing", "not_separable", "nothing_missing", "nothing_missing")
    missed = " ".join(unmet(_all(verdicts=verdicts)))
    for demand in ("nothing hidden", "outside", "constant speed", "standstill"):
        assert demand in missed
    assert "pure sine" not in missed


@pytest.mark.parametrize("verdict", NAMING)
def test_a_wrong_name_is_wrong_everywhere(verdict: str) -> None:
    for case in (*_CASES, *_SILENT):
        outcome = scored(case, lambda _: Answer(verdict, ("backlash",)))
        assert not (outcome.first or outcome.exact or outcome.right) or outcome.truth == ("backlash",), case


def test_no_credit_for_silence_about_an_outside_effect() -> None:
    """A jerk in a slow motion is the limit of a fast mode: that name is accepted, nothing missing is not."""
    case = Case("outside", "jerk", 2, **_SHORT)
    unexplained = scored(case, partial(_said, "unexplained"))
    assert unexplained.flags.inseparable == ("unmodelled_resonance",)
    assert unexplained.right
    assert not scored(case, partial(_said, "nothing_missing")).right
    assert scored(case, lambda _: Answer("cause_found", ("unmodelled_resonance",))).right
    assert not scored(case, lambda _: Answer("cause_found", ("mains_hum",))).right
