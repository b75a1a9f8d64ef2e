"""A plain recording of each name of the vocabulary, of a seed that is drawn anew in each run.

None of the demands holds for every seed: one recording in fifty is answered wrongly. So up to three others of
its kind are tried after it, and only four wrong ones fail. `FOREFEEL_SEED=1234 make test` repeats a run.
"""

import os
import secrets
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.causes.candidate import base_name
from forefeel.common.causes.catalogue import CANDIDATES
from tests.hidden_effects.bench import Population, canonical
from tests.hidden_effects.bench import score as bench
from tests.hidden_effects.cases import QUICK, quick
from tests.hidden_effects.generator import Hidden
from tests.hidden_effects.generator.leftover import gain
from tests.hidden_effects.odd import tried
from tests.hidden_effects.product import diagnosed
from tests.hidden_effects.score import NAMED_SINCE, ON_READINGS, Outcome, compared, flags_of, gained

SEED = int(os.environ.get("FOREFEEL_SEED") or secrets.randbelow(1_000_000))
TRIES = 4
BENCHES = ("known", 678), ("play", 120)  # a capstan, a play: what the bench alone has
ODD = 0, 2, 4, 5, 6, 7, 8, 10, 11, 12, 17, 20
"""Seeds of every base, refused and answered, with most of the changes, of those that cost least."""
ELSEWHERE = {
    "gravity_load", "capstan", "play", "gripper_slip", "buckling", "with_column", "yielding_wall", "prolapse",
    "varying_pulsation",
}  # fmt: skip
"""Names that QUICK has not: BENCHES have two, test_guidewire.py four, and of tests/unit
test_diagnosis_verdicts.py the weight of a link, test_further_columns.py what follows a column, test_rhythm.py
a rate that varies.
"""
_ROUGH = {"coulomb_friction", "stribeck_friction", "position_dependent_friction", "backlash"}
"""What jumps at a reversal: the band takes some of the jump, and so the printed gain is up to .2 smaller."""
_PLAIN = 0.9  # gain from which the band, which takes some of the noise, too, changes it by less than .05


def complaints(outcome: Outcome, hidden: Hidden) -> list[str]:
    """What of an answer is wrong: names, parameters, gain."""
    answer, wrong = outcome.answer, list[str]()
    if not outcome.right:
        wrong.append(f"{answer.verdict} {'+'.join(answer.names)}")
    elif outcome.exact:
        wrong += [f"{estimate}" for estimate in outcome.estimates if estimate.far]
        wrong += [] if gained(outcome) else [f"gain from {answer.gain_low:.3f}"]
        true = gain(hidden)
        if not {*outcome.truth} & (ON_READINGS | _ROUGH) and true > _PLAIN and abs(answer.gain - true) > 0.05:
            wrong.append(f"gain {answer.gain:.3f}, true {true:.3f}")
    return wrong


@cache
def answered(kind: str) -> tuple[Outcome, str]:
    """Of the first recording that is right, or of the last, and what was wrong with all."""
    wrong = []
    for seed in range(SEED, SEED + TRIES):
        hidden = quick(kind, seed).drawn()
        outcome = compared(quick(kind, seed), hidden, flags_of(hidden), diagnosed(hidden))
        against = complaints(outcome, hidden)
        if not against:
            return outcome, ""
        wrong.append(f"{seed} {outcome.labels}: {', '.join(against)}")
    return outcome, "; ".join(wrong)


def test_every_name_is_demanded() -> None:
    names = {NAMED_SINCE.get(kind, kind) for kind in QUICK} | ELSEWHERE
    assert {base_name(form) for form in CANDIDATES} <= names


@pytest.mark.parametrize("kind", QUICK)
def test_diagnosis_finds_what_was_hidden(kind: str) -> None:
    _, wrong = answered(kind)
    assert not wrong, f"FOREFEEL_SEED={SEED}: {wrong}"


def test_intervals_of_95_percent_hold_the_truth() -> None:
    """Of some 30 in a run, of which 94 % do on average: below three quarters luck does not get."""
    estimates = [estimate for kind in QUICK for estimate in answered(kind)[0].estimates]
    assert np.mean([estimate.covered for estimate in estimates]) > 0.75, f"FOREFEEL_SEED={SEED}: {estimates}"


@pytest.mark.parametrize(("population", "seed"), BENCHES)
def test_diagnosis_finds_what_the_bench_has(population: str, seed: int) -> None:
    outcome = bench.scored(Population(population), seed)
    assert outcome.exact, f"{outcome.description}: {outcome.answer}"
    given = {canonical(name): values for name, values in outcome.answer.parameters.items()}
    for name, values in outcome.parameters.items():
        assert {key: given[name][key][0] for key in values} == pytest.approx(values, rel=0.08)


@pytest.mark.parametrize(
    "seed",
    [*ODD, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(400) if seed not in ODD)],
)
def test_odd_recording_has_verdict_and_page_or_clear_line(seed: int, tmp_path: Path) -> None:
    assert tried(seed, tmp_path) == []
