"""One recording put to the diagnosis or a peer, and the answer beside the truth.

This is the only module that imports the product. It stands apart from `__main__`, which the processes of a
pool do not import.
"""

from dataclasses import dataclass, replace

import numpy as np

from forefeel.common.errors import InputError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.regression import ModelFit, RecordingRegression
from forefeel.diagnosis.signals import Signals
from forefeel.diagnosis.verdict import ExpectedGain
from tests.hidden_effects.answers import Answer, Method
from tests.hidden_effects.bench import Made, Population, canonical, draw, draw_two, family_of
from tests.hidden_effects.product import diagnosed

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

    @property
    def found(self) -> bool:
        return self.answer.verdict == "cause_found"

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
    return Outcome(
        population, seed, made.names, made.families, made.hides, made.description, answered(made, method)
    )


def answered(made: Made, method: Method = diagnosed) -> Answer:
    """What a method says of it; where it names `bias` only, the completed baseline is sufficient."""
    try:
        answer = method(made)
    except Exception as error:  # noqa: BLE001 - whatever goes wrong is counted
        return Answer("exception", error=f"{type(error).__name__}: {error}")
    names = tuple(name for name in answer.names if name != "bias")
    if answer.verdict == "cause_found" and not names:
        return replace(answer, verdict="nothing_missing", names=())
    return replace(answer, names=names)


@dataclass(frozen=True)
class Elsewhere:
    """The gain on another motion of the same bench, and what was expected of it.

    `faster`: standard deviation of the other motion's speed by that of the diagnosed one's.
    """

    expected: ExpectedGain
    gain: float
    faster: float
    description: str

    @property
    def holds(self) -> bool:
        return self.expected.gain_low <= self.gain <= self.expected.gain_high


def elsewhere(population: Population, seed: int) -> Elsewhere | None:
    """One recording diagnosed, the other predicted by both of its models; None without an expectation."""
    first, second = draw_two(population, seed)
    try:
        found = diagnose(_recording(first))
    except InputError:
        return None
    expected, regression = found.diagnosis.other_motion, found.analysis.regression
    if expected is None:
        return None
    recording = _recording(second)
    unusable = np.zeros(len(recording), dtype=np.bool_)
    signals = Signals(recording, second.force_n, regression.signals.cutoff_hz, unusable)
    other = regression.like(signals)
    before, after = (_left_n(other, fit) for fit in (regression.fit({"bias": ()}), found.analysis.fit))
    faster = float(np.std(signals.fine_v) / np.std(regression.signals.fine_v))
    names = " + ".join(cause.name for cause in found.diagnosis.causes)
    return Elsewhere(expected, 1.0 - after / before, faster, f"{population.value} {seed}: {names}")


def _left_n(regression: RecordingRegression, fit: ModelFit) -> float:
    return float(np.sqrt(np.mean(regression.residual(fit)[regression.signals.rows] ** 2)))


def _recording(made: Made) -> Recording:
    return Recording("bench", made.time_s, made.position_m, made.force_n, "bench")
