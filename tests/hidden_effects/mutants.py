"""`python -m tests.hidden_effects.mutants [NAME...]`: mutants of the diagnosis against the quick set.

Each lies in one way: swaps names, drops causes, scales numbers, abstains. Prints which tests of the set catch
it. Exit 1: the diagnosis itself is caught, or more than one mutant is not.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from pytest import MonkeyPatch

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.diagnosis import judge, uncertainty
from forefeel.diagnosis.judge import Judge
from forefeel.diagnosis.verdict import NAMING, Cause, HeldOut, Interval
from tests.hidden_effects import test_quick_set as tests
from tests.hidden_effects.cases import QUICK

Mutate = Callable[[MonkeyPatch], None]
_ENOUGH = 3
FAMILY = (
    "stiffening", "contact_loss", "quadratic_drag", "hunt_crossley_damping", "asymmetric_damping",
    "position_dependent_friction", "capstan", "stribeck_friction",
)  # fmt: skip


def swapped(one: str, other: str) -> Mutate:
    """Names one cause by the other's name, and the other way round."""

    def mutate(patch: MonkeyPatch) -> None:
        names: dict[str, str] = {one: other, other: one}
        fitted = Cause.fitted
        patch.setattr(Cause, "fitted", lambda name, *rest: fitted(names.get(name) or name, *rest))

    return mutate


def dropped(*names: str) -> Mutate:
    """Searches without these causes."""

    def mutate(patch: MonkeyPatch) -> None:
        for form in [form for form in CANDIDATES if base_name(form) in names]:
            patch.delitem(CANDIDATES, form)

    return mutate


def scaled(factor: float) -> Mutate:
    """Multiplies each parameter of a cause and its interval."""

    def mutate(patch: MonkeyPatch) -> None:
        def lying(parameters: dict[str, Interval]) -> dict[str, Interval]:
            return {
                name: Interval(factor * size.value, factor * size.low, factor * size.high)
                for name, size in uncertainty.significant(parameters).items()
            }

        patch.setattr(judge, "significant", lying)

    return mutate


def widened(factor: float) -> Mutate:
    """Multiplies the width of every interval."""
    return lambda patch: patch.setattr(uncertainty, "WIDER", factor * uncertainty.WIDER)


def abstaining(patch: MonkeyPatch) -> None:
    """Says `unexplained` where causes are to be named."""
    diagnosis = Judge._diagnosis

    def lying(self: Judge, due: Any, *rest: Any, **named: Any) -> Any:  # noqa: ANN401
        return diagnosis(self, "unexplained" if due in NAMING else due, *rest, **named)

    patch.setattr(Judge, "_diagnosis", lying)


def without(rule: str, answer: object) -> Mutate:
    """Answers the same whenever this rule of the judge is asked, a method or a property."""
    method = callable(getattr(Judge, rule))
    given: object = (lambda *_: answer) if method else property(lambda _: answer)
    return lambda patch: patch.setattr(Judge, rule, given)


def gaining(lie: Callable[[HeldOut], HeldOut]) -> Mutate:
    """Changes every gain on held-out blocks."""

    def mutate(patch: MonkeyPatch) -> None:
        patch.setattr(judge, "gain", lambda *measured: lie(uncertainty.gain(*measured)))

    return mutate


def halved(gain: HeldOut) -> HeldOut:
    return replace(gain, gain=gain.gain / 2, gain_low=gain.gain_low / 2, gain_high=gain.gain_high / 2)


MUTANTS: dict[str, Mutate] = {
    "stiffening and hunt_crossley_damping swapped": swapped("stiffening", "hunt_crossley_damping"),
    "coulomb_friction and presliding_hysteresis swapped": swapped(
        "coulomb_friction", "presliding_hysteresis"
    ),
    "eight causes dropped": dropped(*FAMILY),
    "every parameter halved": scaled(0.5),
    "every parameter 9 % larger": scaled(1.09),
    "intervals / 20": widened(0.05),
    "always abstains": abstaining,
    "never abstains": without("_without_cause", None),
    "no structure is ever left": without("_structure_left", False),
    "weak causes stay": without("_is_weak", False),
    "gain always .9": gaining(lambda gain: replace(gain, gain=0.9, gain_low=0.85, gain_high=0.95)),
    "gain halved": gaining(halved),
}


def caught_by(mutate: Mutate) -> list[str]:
    """Tests of the quick set that fail under a mutant, the first _ENOUGH."""
    caught = list[str]()
    tests.answered.cache_clear()
    with MonkeyPatch.context() as patch:
        mutate(patch)
        trials = {kind: partial(tests.test_diagnosis_finds_what_was_hidden, kind) for kind in QUICK}
        trials["intervals"] = partial(tests.test_intervals_of_95_percent_hold_the_truth)
        for bench in tests.BENCHES:
            trials[str(bench)] = partial(tests.test_diagnosis_finds_what_the_bench_has, *bench)
        for name, trial in trials.items():
            try:
                trial()
            except AssertionError:
                caught.append(name)
            if len(caught) == _ENOUGH:
                break
    return caught


def main(names: Sequence[str]) -> int:
    """Tries each mutant, or those that `names` are part of; the exit code."""
    wrong = caught_by(lambda _: None)
    print(f"seed {tests.SEED}; the diagnosis itself: caught by {wrong or 'none'}", flush=True)
    caught = 0
    chosen = [name for name in MUTANTS if not names or any(part in name for part in names)]
    for name in chosen:
        by = caught_by(MUTANTS[name])
        caught += bool(by)
        print(f"{name}: caught by {', '.join(by) or 'none'}", flush=True)
    print(f"{caught} of {len(chosen)} mutants caught by what `make test` runs")
    return 1 if wrong or caught < len(chosen) - 1 else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
