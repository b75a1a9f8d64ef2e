"""A dozen recordings of both generators, each with the demand of its group; more in `make hidden-effects`."""

from pathlib import Path

import pytest

from tests.hidden_effects.bench import Population
from tests.hidden_effects.bench import score as bench
from tests.hidden_effects.cases import Case, quick
from tests.hidden_effects.odd import tried
from tests.hidden_effects.product import diagnosed
from tests.hidden_effects.score import gained, scored

BENCHES = ("known", 705), ("play", 108)


@pytest.mark.parametrize("case", quick(), ids=str)
def test_diagnosis_finds_what_was_hidden(case: Case) -> None:
    outcome = scored(case, diagnosed)
    assert outcome.right, f"{outcome.truth} {outcome.labels} in {outcome.motion}: {outcome.answer}"
    assert all(estimate.good for estimate in outcome.estimates), outcome.estimates
    assert gained(outcome) or not outcome.exact, outcome.answer


@pytest.mark.parametrize(("population", "seed"), BENCHES)
def test_diagnosis_finds_what_the_bench_has(population: str, seed: int) -> None:
    outcome = bench.scored(Population(population), seed)
    assert outcome.exact, f"{outcome.description}: {outcome.answer}"


@pytest.mark.parametrize("seed", range(12))
def test_odd_recording_has_verdict_and_page_or_clear_line(seed: int, tmp_path: Path) -> None:
    outcome = tried(seed, tmp_path)
    assert not outcome.error, f"{outcome.words}: {outcome.error}"
