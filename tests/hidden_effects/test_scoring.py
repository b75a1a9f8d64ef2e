"""The harness itself: what counts as right, what is counted, what is missed."""

from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import Any

import pytest

from tests.hidden_effects.answers import NAMING, Answer, Interval
from tests.hidden_effects.cases import Case
from tests.hidden_effects.equivalences import comparable, right_first, same_names
from tests.hidden_effects.generator import Hidden, Truth, draw
from tests.hidden_effects.score import Flags, Outcome, compared, flags_of
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


@cache
def _shown(case: Case) -> tuple[Hidden, Flags]:
    hidden = case.drawn()
    return hidden, flags_of(hidden)


def _scored(case: Case, answer: Answer | Callable[[Hidden], Answer]) -> Outcome:
    hidden, flags = _shown(case)
    return compared(case, hidden, flags, answer if isinstance(answer, Answer) else answer(hidden))


def _knowing(factor: float, verdict: str, hidden: Hidden) -> Answer:
    """Answer of a method that knows the truth, its parameters off by a factor."""
    parameters = {
        effect: {name: (factor * v, v - abs(v) * 0.01, v + abs(v) * 0.01) for name, v in given.items()}
        for effect, given in hidden.truth.parameters.items()
    }
    return Answer(verdict, hidden.truth.names, parameters, gain_low=0.1, seconds=0.5)


_NAMED = {
    Case("single", "quadratic_drag", 1, **_SHORT): "cause_found",
    Case("quarter", "stiffening", 1, 0.25, **_SHORT): "partly_explained",
    Case("pair", "bias+sensor_drift", 1, **_SHORT): "cause_found",
}
_SILENT = {
    Case("nothing", "nothing", 1, **_SHORT): "nothing_missing",
    Case("outside", "chirp", 1, **_SHORT): "unexplained",
    Case("pure_sine", "pure_sine", 1, **_SHORT): "not_separable",
    Case("constant_speed", "constant_speed", 1, **_SHORT): "not_separable",
    Case("standstill", "standstill", 1, **_SHORT): "refused",
}


def _all(factor: float = 1.0, verdicts: Iterable[str] = _SILENT.values()) -> list[Outcome]:
    named = [_scored(case, partial(_knowing, factor, verdict)) for case, verdict in _NAMED.items()]
    return named + [_scored(case, Answer(verdict)) for case, verdict in zip(_SILENT, verdicts, strict=True)]


def test_an_answer_as_demanded_misses_nothing_and_parameters_that_are_off_are_counted() -> None:
    assert unmet(_all()) == []
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
    nothing, *_ = _SILENT
    assert not _scored(nothing, Answer("unexplained")).right


@pytest.mark.parametrize("verdict", NAMING)
def test_a_wrong_name_is_wrong_everywhere(verdict: str) -> None:
    for case in (*_NAMED, *_SILENT):
        outcome = _scored(case, Answer(verdict, ("backlash",)))
        assert not (outcome.first or outcome.exact or outcome.right) or outcome.truth == ("backlash",), case


def test_no_credit_for_silence_about_an_outside_effect() -> None:
    """A jerk in a slow motion is the limit of a fast mode: that name is accepted, nothing missing is not."""
    case = Case("outside", "jerk", 2, **_SHORT)
    assert _shown(case)[1].inseparable == ("unmodelled_resonance",)
    for answer, right in (
        (Answer("unexplained"), True),
        (Answer("nothing_missing"), False),
        (Answer("cause_found", ("unmodelled_resonance",)), True),
        (Answer("cause_found", ("mains_hum",)), False),
    ):
        assert _scored(case, answer).right == right
