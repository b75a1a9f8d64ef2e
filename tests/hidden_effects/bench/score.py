"""One recording put to the diagnosis or a peer, and the answer beside the truth.

This is the only module that imports the product. It stands apart from `__main__`, which the processes of a
pool do not import.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from forefeel.common.errors import InputError
from forefeel.diagnosis.confirmation import Confirmation, confirm
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.verdict import ExpectedGain
from tests.hidden_effects.answers import Answer, Method
from tests.hidden_effects.bench import Made, Population, canonical, draw, draw_two, family_of
from tests.hidden_effects.product import diagnosed, recording_of

ABSTENTIONS = ("not_separable", "unexplained", "nothing_found", "not_driven_by_this_axis", "refused")
"""Verdicts that name no cause; `refused` stands for an input error."""


@dataclass(frozen=True)
class Outcome:
    """One recording: its truth and the answer."""

    population: Population
    seed: int
    names: frozenset[str]
    families: frozenset[str]
    hides: bool
    description: str
    answer: Answer
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def found(self) -> bool:
        return self.answer.names_causes

    @property
    def right_first(self) -> bool:
        return self.found and family_of(self.answer.names[0]) in self.families

    @property
    def wrong_first(self) -> bool:
        return self.found and not self.right_first

    @property
    def abstained(self) -> bool:
        return self.answer.verdict in ABSTENTIONS

    @property
    def missed(self) -> bool:
        """Nothing is missing, it was said, although something is hidden."""
        return self.hides and self.answer.verdict == "nothing_missing"

    @property
    def exact(self) -> bool:
        """The true names and no other; without any, `nothing_missing` or an abstention, as it is due."""
        if not self.hides:
            return self.answer.verdict == "nothing_missing"
        if not self.names:
            return self.abstained
        return self.found and frozenset(map(canonical, self.answer.names)) == self.names


def scored(population: Population, seed: int, method: Method = diagnosed) -> Outcome:
    made = draw(population, seed)
    answer, truth = answered(made, method), (made.names, made.families, made.hides, made.description)
    return Outcome(population, seed, *truth, answer, made.parameters)


def answered(made: Made, method: Method = diagnosed) -> Answer:
    """What a method says of it; where it names `bias` only, the completed baseline is sufficient."""
    try:
        answer = method(made)
    except Exception as error:  # noqa: BLE001 - whatever goes wrong is counted
        return Answer("exception", error=f"{type(error).__name__}: {error}")
    names = tuple(name for name in answer.names if name != "bias")
    if answer.names_causes and not names:
        return replace(answer, verdict="nothing_missing", names=())
    return replace(answer, names=names)


@dataclass(frozen=True)
class Elsewhere:
    """A model on another motion of the same bench: what was expected of its gain, and what came of it.

    `right`: every name but the bias is hidden there. `faster`: standard deviation of the other motion's speed
    by that of the diagnosed one's.
    """

    expected: ExpectedGain | None
    confirmation: Confirmation
    right: bool
    faster: float
    description: str

    @property
    def holds(self) -> bool:
        expected, gain = self.expected, self.confirmation.gain
        assert expected is not None
        assert gain is not None
        return expected.gain_low <= gain.gain <= expected.gain_high


def elsewhere(population: Population, seed: int) -> Elsewhere | None:
    """One recording diagnosed, and its model held against the other; None where no cause is named."""
    first, second = draw_two(population, seed)
    try:
        found = diagnose(recording_of(first))
    except InputError:
        return None
    names = [cause.name for cause in found.diagnosis.causes if cause.name != "bias"]
    if not names:
        return None
    confirmation = confirm(found, recording_of(second)).confirmation
    right = {canonical(name) for name in names} <= first.names
    faster = float(np.std(np.diff(second.position_m)) / np.std(np.diff(first.position_m)))
    description = f"{population.value} {seed}: {' + '.join(names)}"
    return Elsewhere(found.diagnosis.other_motion, confirmation, right, faster, description)
