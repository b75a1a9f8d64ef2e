"""One bench: its poor first recording, the answer to the motion asked for, and what was named of either."""

import time
from dataclasses import asdict, dataclass, replace

from forefeel.common.errors import InputError
from forefeel.diagnosis.diagnose import Diagnosed
from forefeel.diagnosis.investigation import investigate, judge
from tests.hidden_effects.asked.bench import Bench
from tests.hidden_effects.generator.rivals import inseparable
from tests.hidden_effects.product import recording_of
from tests.hidden_effects.score import NAMED_SINCE

_SISTERS = {"capstan": "position_dependent_friction", "play": "backlash"}

_FRICTIONS = {"coulomb_friction", "stribeck_friction", "presliding_hysteresis", "position_dependent_friction"}
"""Sisters: another dry friction is not right, and not wrong either."""


@dataclass(frozen=True)
class Outcome:
    """Names of the first recording, of the answer, and of what that refused, in its `verdict`.

    `alike`: names that the answer can not be told from. `cut`: times that the force limit was met.
    """

    kind: str
    number: int
    hidden: frozenset[str]
    verdict: str
    first: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()
    confirmation: str = ""
    ratio: float = 0.0
    refused: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()
    cut: int = 0
    seconds: float = 0.0

    @property
    def group(self) -> str:
        return "cause" if self.number < 57 else "outside" if self.number < 73 else "nothing"

    @property
    def right(self) -> bool:
        return plain(self.answer) == self.hidden

    @property
    def first_right(self) -> bool:
        return plain(self.first) == self.hidden

    @property
    def wrong(self) -> bool:
        named = [_SISTERS.get(name, name) for name in self.answer if name != "bias"]
        known = self.hidden | set(self.alike) | (_FRICTIONS if _FRICTIONS & self.hidden else set())
        return bool(named) and named[0] not in known and self.confirmation == "confirmed"

    def __str__(self) -> str:
        first, answer, refused = ("+".join(n) or "-" for n in (self.first, self.answer, self.refused))
        told = [self.verdict]
        told += [f"{self.confirmation} {self.ratio:.2f}"] if self.confirmation else []
        told += [f"refused {refused}"] if self.refused else []
        told += [f"cut {self.cut} times"] if self.cut else []
        return f"{self.number:3d} {self.kind}: {first} => {answer} ({', '.join(told)}) {self.seconds:.1f} s"


def plain(names: tuple[str, ...]) -> frozenset[str]:
    return frozenset(_SISTERS.get(name, name) for name in names) - {"bias"}


def outcome(seed: int, narrow: bool, duration_s: float, case: tuple[int, str]) -> Outcome:
    number, kind = case
    bench = Bench(kind, seed, number, narrow)
    start_s = time.process_time()
    hidden = frozenset(NAMED_SINCE.get(name, name) for name in bench.names)
    first: tuple[str, ...] = ()
    try:
        asked = investigate(recording_of(bench.first()), asdict(bench.limits), duration_s)
        first = _names(asked.diagnosed) if asked.diagnosed else ()
        answered = bench.answer(asked.limits, duration_s)
        judged = judge(asked, recording_of(answered))
    except InputError as error:  # a force that never changes, or a motion that the force limit ends at once
        return Outcome(kind, number, hidden, str(error), first)
    verdict = judged.diagnosed.diagnosis.verdict + ("" if judged.of == "answer" else f" of {judged.of}")
    refused = tuple(cause.name for cause in judged.refused.causes) if judged.refused else ()
    found = Outcome(kind, number, hidden, verdict, first, _names(judged.diagnosed), refused=refused)
    confirmation = judged.replay.confirmation if judged.replay else None
    return replace(
        found,
        confirmation=confirmation.verdict if confirmation else "",
        ratio=confirmation.ratio if confirmation else 0.0,
        alike=inseparable(answered) if found.group == "outside" else (),
        cut=bench.force_limit_met,
        seconds=time.process_time() - start_s,
    )


def _names(diagnosed: Diagnosed) -> tuple[str, ...]:
    return tuple(cause.name for cause in diagnosed.diagnosis.causes)
