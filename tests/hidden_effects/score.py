"""One answer against what was hidden."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from tests.hidden_effects.answers import Answer
from tests.hidden_effects.cases import Case
from tests.hidden_effects.equivalences import comparable, only_hidden, right_first, same_names
from tests.hidden_effects.generator import Hidden
from tests.hidden_effects.generator.bounds import relative_bounds
from tests.hidden_effects.generator.leftover import leftovers_n, noise_floor_n
from tests.hidden_effects.generator.rivals import inseparable

BOUND_JUDGED = 0.05
"""Where the Cramer-Rao bound is below this a value has to be within TOLERANCE, elsewhere in its interval."""
TOLERANCE = 0.10
NAMED_SINCE = {"position_ripple": "position_map", "breathing_spring": "varying_pulsation"}
"""Effects of the generator's group without a name that have one since, which is demanded."""


@dataclass(frozen=True)
class Estimate:
    """One hidden parameter as it was found. `bound` is the relative Cramer-Rao bound."""

    effect: str
    parameter: str
    true: float
    value: float
    low: float
    high: float
    bound: float

    @property
    def close(self) -> bool:
        return abs(self.value - self.true) <= TOLERANCE * abs(self.true)

    @property
    def covered(self) -> bool:
        return self.low <= self.true <= self.high

    @property
    def far(self) -> bool:
        """Not given; or out of its interval and off by more than 5 standard deviations of the bound + 1 %."""
        near = abs(self.value - self.true) <= (5.0 * self.bound + 0.01) * abs(self.true)
        return not (near or self.covered)

    @property
    def good(self) -> bool:
        """What the recording allows to ask for."""
        return self.close if self.bound < BOUND_JUDGED else self.covered


@dataclass(frozen=True)
class Flags:
    """What the recording can not show: effects below the noise, names that it does not separate."""

    below_floor: bool
    inseparable: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """One case: what was hidden, what was answered, how that compares."""

    case: Case
    truth: tuple[str, ...]
    labels: tuple[str, ...]
    motion: str
    samples: int
    flags: Flags
    answer: Answer
    first: bool
    exact: bool
    right: bool
    estimates: tuple[Estimate, ...]

    @property
    def asked(self) -> bool:
        """Whether the recording shows enough for the name to be asked for."""
        return not self.flags.below_floor and not self.flags.inseparable


def scored(case: Case, method: Callable[[Hidden], Answer]) -> Outcome:
    hidden = case.drawn()
    return compared(case, hidden, flags_of(hidden), method(hidden))


def compared(case: Case, hidden: Hidden, flags: Flags, answer: Answer) -> Outcome:
    """The answer about the recording of a case beside its truth."""
    truth = hidden.truth
    due = answer.names_causes if truth.names else answer.verdict == "nothing_missing"
    exact = due and same_names(truth, answer.names)
    return Outcome(
        case=case,
        truth=truth.names,
        labels=truth.labels,
        motion=truth.motion,
        samples=len(hidden.time_s),
        flags=flags,
        answer=answer,
        first=right_first(truth, answer.names),
        exact=exact,
        right=_right(case.group, hidden, answer, flags, exact),
        estimates=_estimates(hidden, answer) if case.group in ("single", "quarter", "pair") else (),
    )


def flags_of(hidden: Hidden) -> Flags:
    """Computed from the noise-free recording and the generator's own models."""
    below = any(left < noise_floor_n(hidden) for left in leftovers_n(hidden))
    return Flags(below and "outside" not in hidden.truth.labels, inseparable(hidden))


_DUE = {"constant_speed": "not_separable", "standstill": "refused"}


def _right(group: str, hidden: Hidden, answer: Answer, flags: Flags, exact: bool) -> bool:
    """The one demand of each group."""
    if group == "outside":
        since = NAMED_SINCE.get(hidden.truth.names[0])
        if since:
            return set(answer.names) - {"bias"} == {since}
        return answer.verdict == "unexplained" or _rival_named(answer, flags)
    if group == "pure_sine":
        return not answer.names or len(answer.names) > 1 or only_hidden(hidden.truth, answer.names)
    if group in _DUE:
        return answer.verdict == _DUE[group]
    if flags.inseparable and answer.verdict == "not_separable":
        return any(set(hidden.truth.names) <= set(names) for names in answer.rivals)
    return exact


def _rival_named(answer: Answer, flags: Flags) -> bool:
    """An effect outside of the vocabulary that a name explains to within the noise may be given that name."""
    named = {*answer.names, *(name for names in answer.rivals for name in names)}
    return bool(named & set(flags.inseparable)) and len(answer.names) <= 1


def _estimates(hidden: Hidden, answer: Answer) -> tuple[Estimate, ...]:
    """Of the effects that were named; a parameter that is not given is not a number."""
    bounds, nothing = relative_bounds(hidden), (float("nan"),) * 3
    found = []
    for effect, parameters in hidden.truth.parameters.items():
        if effect in answer.names:
            given = comparable(answer, effect)
            found += [
                Estimate(effect, name, true, *given.get(name, nothing), bounds[effect][name])
                for name, true in parameters.items()
            ]
    return tuple(found)


ON_READINGS = frozenset({"bias", "sensor_saturation", "sensor_quantisation", "sensor_spikes", "mains_hum"})
"""The baseline has a bias, too, and is compared on readings that are freed of the sensor's faults."""


def gained(outcome: Outcome) -> bool:
    """Whether the interval of the held-out gain lies above zero, or no gain is to be had."""
    if set(outcome.truth) <= ON_READINGS:
        return True
    return isfinite(outcome.answer.gain_low) and outcome.answer.gain_low > 0.0
