"""`python -m tests.hidden_effects.mutants [NAME...]`: mutants of the diagnosis against `make test`'s dozen.

Each lies in one way: swaps names, drops causes, scales numbers, abstains. Prints which of the dozen catch it.
Exit 1: the diagnosis itself is caught.
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
from forefeel.diagnosis.verdict import Cause, HeldOut, Interval, VerdictName
from tests.hidden_effects.cases import quick
from tests.hidden_effects.test_quick_set import (
    BENCHES,
    test_diagnosis_finds_what_the_bench_has,
    test_diagnosis_finds_what_was_hidden,
)

Mutate = Callable[[MonkeyPatch], None]
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


def answering(verdict: VerdictName, instead_of: VerdictName) -> Mutate:
    """Says one verdict where another is due."""

    def mutate(patch: MonkeyPatch) -> None:
        diagnosis = Judge._diagnosis

        def lying(self: Judge, due: Any, *rest: Any, **named: Any) -> Any:  # noqa: ANN401
            return diagnosis(self, verdict if due == instead_of else due, *rest, **named)

        patch.setattr(Judge, "_diagnosis", lying)

    return mutate


def without(rule: str, answer: object) -> Mutate:
    """Answers the same whenever this rule of the judge is asked."""
    return lambda patch: patch.setattr(Judge, rule, lambda *_: answer)


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
    "always abstains": answering("unexplained", "cause_found"),
    "never abstains": without("_inexplicable", None),
    "no structure is ever left": without("_structure_left", False),
    "weak causes stay": without("_is_weak", False),
    "gain always .9": gaining(lambda gain: replace(gain, gain=0.9, gain_low=0.85, gain_high=0.95)),
    "gain halved": gaining(halved),
}


def caught_by(mutate: Mutate) -> list[str]:
    """Recordings of the dozen whose test fails under a mutant."""
    caught = list[str]()
    with MonkeyPatch.context() as patch:
        mutate(patch)
        trials = {str(case): partial(test_diagnosis_finds_what_was_hidden, case) for case in quick()}
        for bench in BENCHES:
            trials[str(bench)] = partial(test_diagnosis_finds_what_the_bench_has, *bench)
        for name, trial in trials.items():
            try:
                trial()
            except AssertionError:
                caught.append(name)
    return caught


def main(names: Sequence[str]) -> int:
    """Tries each mutant, or those that `names` are part of; 1 where the diagnosis itself is caught."""
    wrong = caught_by(lambda _: None)
    print(f"the diagnosis itself: caught by {wrong or 'none'}", flush=True)
    caught = 0
    chosen = [name for name in MUTANTS if not names or any(part in name for part in names)]
    for name in chosen:
        by = caught_by(MUTANTS[name])
        caught += bool(by)
        print(f"{name}: caught by {len(by)}: {', '.join(by) or 'none'}", flush=True)
    print(f"{caught} of {len(chosen)} mutants caught by what `make test` runs")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
