"""The quick set: 25 short recordings, each with the demand of its group; the longest of them in the soak."""

import pytest

from tests.hidden_effects.cases import Case, quick
from tests.hidden_effects.product import diagnosed
from tests.hidden_effects.score import gained, scored

LONG = ("breathing_spring", "pulsation", "position_ripple", "time_delay", "unmodelled_resonance")


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
    if outcome.exact and set(outcome.truth) - {"bias"}:  # which the baseline has, too
        assert gained(outcome), outcome.answer
