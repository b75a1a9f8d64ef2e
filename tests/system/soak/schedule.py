"""Which fault comes when, from a seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

OFTEN = ("freeze slave", "freeze master", "freeze recorder", "emergency stop", "load cell NaN")
RARE = ("kill slave", "kill master", "kill recorder")
"""At most once in ten minutes each, so that a process lives for long enough to be measured."""
_KILLS_EVERY_S = 600.0
_KILLS_BETWEEN = (0.65, 0.70)
FIRST_S, _SOON_S = 5.0, 4.0
WARM_S = FIRST_S + 2 * len(OFTEN) * _SOON_S
LONGEST_S = 2.0


@dataclass(frozen=True, slots=True)
class Fault:
    """`at_s`: since the start, or as soon after as the one before is over."""

    at_s: float
    kind: str
    lasts_s: float


def schedule(seed: int, duration_s: float) -> list[Fault]:
    """All of a run, in their order; none in the last ten seconds."""
    random = Random(f"soak {seed}")
    faults = [*_often(random, duration_s), *_rare(random, duration_s)]
    return sorted((f for f in faults if f.at_s < duration_s - 10.0), key=lambda fault: fault.at_s)


def _often(random: Random, duration_s: float) -> Iterator[Fault]:
    """First each kind twice, soon; then at random."""
    for i, kind in enumerate(2 * OFTEN):
        yield Fault(FIRST_S + i * _SOON_S, kind, random.uniform(0.5 * LONGEST_S, LONGEST_S))
    mean_s = 10.0 if duration_s < _KILLS_EVERY_S else 30.0
    at_s, kinds = WARM_S, list[str]()
    while at_s < duration_s:
        if not kinds:  # each kind once before one comes again
            kinds = random.sample(OFTEN, len(OFTEN))
        yield Fault(at_s, kinds.pop(), random.uniform(0.1, LONGEST_S))
        at_s += random.uniform(0.5, 1.5) * mean_s


def _rare(random: Random, duration_s: float) -> Iterator[Fault]:
    spans = max(1, int(duration_s // _KILLS_EVERY_S))
    length_s = duration_s / spans
    for span in range(spans):
        for kind in RARE:
            yield Fault((span + random.uniform(*_KILLS_BETWEEN)) * length_s, kind, 0.0)
