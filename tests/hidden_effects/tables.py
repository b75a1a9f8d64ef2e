"""The confusion table and the rates, as text."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from tests.hidden_effects.score import BOUND_JUDGED, Outcome, gained

_SILENT = ("nothing_missing", "nothing_found")
"""Verdicts that nothing is missing; whether the noise is known is another question."""


class Rate(NamedTuple):
    """How many of how many; `least` and `most` are shares that are demanded."""

    what: str
    hits: int
    total: int
    least: float = 0.0
    most: float = 1.0

    @property
    def met(self) -> bool:
        """Nothing counted is nothing missed."""
        return self.total == 0 or self.least <= self.hits / self.total <= self.most

    def __str__(self) -> str:
        asked = f">= {100.0 * self.least:.0f} %" if self.least else "none" if self.most == 0.0 else ""
        reached = f"{100.0 * self.hits / self.total:5.1f} %" if self.total else "    - "
        return f"{self.what:<70s} {asked:>8s}  {reached}  ({self.hits} of {self.total})"


def report(
    title: str, outcomes: Sequence[Outcome], intervals: bool = True, known: Collection[str] = ()
) -> str:
    """All tables of one method; `known`: the only names that it can give, where it can not give all."""
    parts = [confusion(outcomes), rates(outcomes, intervals), speed(outcomes), misses(outcomes)]
    if known:
        of_known = [outcome for outcome in outcomes if set(outcome.truth) <= set(known)]
        lines = [f"  {rate}" for rate in _name_rates(of_known)]
        parts.append("\n".join([f"of those that hide only {', '.join(sorted(known))}:", *lines]))
    return "\n\n".join([f"== {title}", *parts, far_off(outcomes)])


def confusion(outcomes: Iterable[Outcome]) -> str:
    """One line for each hidden name of the single effects, whatever their size: how often each
    answer came."""
    rows: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        single = outcome.case.group in ("single", "quarter")
        hidden = outcome.truth[0] if single else f"[{outcome.case.group}]"
        right = outcome.exact if single else outcome.right
        names = "=" if right else "+".join(sorted(outcome.answer.names)) or outcome.answer.verdict
        answer = f"{names} as partly" if outcome.answer.partly else names
        rows.setdefault(hidden, Counter())[answer] += 1
    lines = ["confusion: hidden -> answered (times); '=' is the demanded one, 'as partly': beside more"]
    for hidden, counts in rows.items():
        said = ", ".join(f"{answer} {count}" for answer, count in counts.most_common())
        lines.append(f"  {hidden:<28s} {said}")
    return "\n".join(lines)


def rates(outcomes: Sequence[Outcome], intervals: bool = True) -> str:
    lines = [f"  {rate}{'' if rate.met else '  missed'}" for rate in all_rates(outcomes, intervals)]
    return "\n".join(["rates: what, demanded, reached", *lines])


def unmet(outcomes: Sequence[Outcome]) -> list[str]:
    return [str(rate) for rate in all_rates(outcomes) if not rate.met]


def all_rates(outcomes: Sequence[Outcome], intervals: bool = True) -> list[Rate]:
    return [*_name_rates(outcomes), *_verdict_rates(outcomes), *_parameter_rates(outcomes, intervals)]


def _rate(
    what: str,
    outcomes: Iterable[Outcome],
    hit: Callable[[Outcome], bool],
    least: float = 0.0,
    most: float = 1.0,
) -> Rate:
    hits = [hit(outcome) for outcome in outcomes]
    return Rate(what, sum(hits), len(hits), least, most)


def _name_rates(outcomes: Sequence[Outcome]) -> list[Rate]:
    single, quarter, pair = (_group(outcomes, name) for name in ("single", "quarter", "pair"))
    shown, above = ([o for o in group if o.asked] for group in (single, quarter))
    return [
        _rate("single, right name first", single, lambda o: o.first, 0.98),
        _rate("single, exact set", single, lambda o: o.exact, 0.95),
        _rate("single, exact set, those that the motion separates", shown, lambda o: o.exact),
        _rate("quarter, right name first, above the floor and separable", above, lambda o: o.first, 0.9),
        _rate("quarter, exact set, above the floor and separable", above, lambda o: o.exact),
        _rate("quarter, right name first, all", quarter, lambda o: o.first),
        _rate("pair, right name first", pair, lambda o: o.first),
        _rate("pair, exact set", pair, lambda o: o.exact, 0.85),
        _rate("of the three, named as partly", [*single, *quarter, *pair], lambda o: o.answer.partly),
    ]


def _verdict_rates(outcomes: Sequence[Outcome]) -> list[Rate]:
    outside, steady = _group(outcomes, "outside"), _group(outcomes, "constant_speed")
    none = _group(outcomes, "nothing")
    return [
        _rate("nothing hidden, false alarm", none, lambda o: o.answer.verdict not in _SILENT, most=0.0),
        _rate("nothing hidden, `nothing_found`", none, lambda o: o.answer.verdict == "nothing_found"),
        _rate("outside of the vocabulary, `unexplained` or its name since", outside, lambda o: o.right, 0.95),
        _rate("outside of the vocabulary, a name given", outside, lambda o: bool(o.answer.names)),
        _rate("outside of the vocabulary, a name given as partly", outside, lambda o: o.answer.partly),
        _rate(
            "pure sine, a wrong single name", _group(outcomes, "pure_sine"), lambda o: not o.right, most=0.0
        ),
        _rate("constant speed, `not_separable`", steady, lambda o: o.right, 1.0),
        _rate("standstill, refused", _group(outcomes, "standstill"), lambda o: o.right, 1.0),
    ]


def _parameter_rates(outcomes: Sequence[Outcome], intervals: bool) -> list[Rate]:
    """Of exact sets: parameters and gain of a wrong model mean nothing. The peer gives no intervals."""
    found = [e for o in outcomes if o.exact for e in o.estimates]
    sharp = [e for e in found if e.bound < BOUND_JUDGED]
    wide = [e for e in found if e.bound >= BOUND_JUDGED]
    close = Rate("parameters within 10 %, bound below 5 %", sum(e.close for e in sharp), len(sharp), 0.95)
    if not intervals:
        return [close]
    exact = [o for o in outcomes if o.exact and o.truth]
    return [
        close,
        _rate("held-out gain above 0, exact sets", exact, gained, 0.95),
        Rate("parameters in their interval, bound of 5 % or more", sum(e.covered for e in wide), len(wide)),
        Rate("95 % intervals that hold the truth", sum(e.covered for e in found), len(found), 0.9),
    ]


def _group(outcomes: Iterable[Outcome], group: str) -> list[Outcome]:
    return [outcome for outcome in outcomes if outcome.case.group == group]


def speed(outcomes: Sequence[Outcome]) -> str:
    seconds = np.array([o.answer.seconds for o in outcomes])
    each = seconds / np.array([o.samples for o in outcomes]) * 30_000.0
    return (
        f"time: median {np.median(seconds):.2f} s, longest {np.max(seconds):.2f} s for a recording; "
        f"per 30,000 samples median {np.median(each):.2f} s, 95 % below {np.percentile(each, 95.0):.2f} s"
    )


def misses(outcomes: Iterable[Outcome]) -> str:
    """Every case that is not as demanded, with what the recording shows of it."""
    lines = []
    for o in (outcome for outcome in outcomes if not outcome.right):
        hidden = " + ".join(f"{n} ({label})" for n, label in zip(o.truth, o.labels, strict=True))
        flags = " | below the floor" * o.flags.below_floor
        if o.flags.inseparable:
            flags += f" | inseparable from {', '.join(o.flags.inseparable)}"
        answer = f"{o.answer.verdict} {'+'.join(o.answer.names)}".strip()
        lines.append(f"  {o.case}: {hidden or 'nothing'} in {o.motion} -> {answer}{flags}")
    return "\n".join([f"not as demanded: {len(lines)}", *lines])


def far_off(outcomes: Iterable[Outcome]) -> str:
    """Every parameter of an exact set that is not as good as the recording allows."""
    lines = [
        f"  {o.case}: {e.effect}.{e.parameter} {e.true:.4g}, "
        f"found {e.value:.4g} [{e.low:.4g}, {e.high:.4g}], bound {100.0 * e.bound:.2g} %"
        for o in outcomes
        if o.exact
        for e in o.estimates
        if not e.good
    ]
    return "\n".join([f"parameters of exact sets that are off: {len(lines)}", *lines])
