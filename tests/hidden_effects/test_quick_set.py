"""The quick sets: 25 short recordings of the first generator, each with the demand of its group, the longest
of them in the soak; and of the bench one for most families, and some that hide nothing or hardly show it.
"""

import pytest

from tests.hidden_effects.bench import Population
from tests.hidden_effects.bench import score as bench
from tests.hidden_effects.cases import Case, quick
from tests.hidden_effects.product import diagnosed
from tests.hidden_effects.score import gained, scored

LONG = ("breathing_spring", "pulsation", "position_ripple", "time_delay", "unmodelled_resonance")

SEEN_ANYWAY = {"bias", "sensor_saturation", "sensor_quantisation"}
"""The baseline has a bias, too, and is compared on readings that are freed of the sensor's faults."""

OF_THE_BENCH = (
    ("known", 704), ("known", 705), ("known", 706), ("known", 714), ("known", 715), ("known", 719),
    ("known", 722), ("known", 751), ("known", 755), ("known", 720), ("known", 737), ("known", 723),
    ("known", 741), ("known", 726), ("play", 105), ("play", 108), ("nothing", 103), ("hum", 103),
    ("slow", 101),
)  # fmt: skip


def cases() -> list[object]:
    return [
        pytest.param(case, id=str(case), marks=[pytest.mark.soak] if str(case).startswith(LONG) else [])
        for case in quick()
    ]


@pytest.mark.parametrize("case", cases())
def test_finds_what_was_hidden(case: Case) -> None:
    outcome = scored(case, diagnosed)
    assert outcome.right, f"{outcome.truth} {outcome.labels} in {outcome.motion}: {outcome.answer}"
    assert all(estimate.good for estimate in outcome.estimates), outcome.estimates
    if outcome.exact and set(outcome.truth) - SEEN_ANYWAY:
        assert gained(outcome), outcome.answer


@pytest.mark.parametrize(("population", "seed"), OF_THE_BENCH)
def test_finds_what_the_bench_has(population: str, seed: int) -> None:
    outcome = bench.scored(Population(population), seed)
    assert outcome.exact, f"{outcome.description}: {outcome.answer}"
