"""Both ends' counters and the listener's own, sorted by what they mean for the operator. Pure."""

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from forefeel.common.events.console import printable
from forefeel.common.messages import MasterState, SlaveState

_KINDS = (
    ("late", ("late",)),
    ("reordered", ("reordered", "sequence", "duplicat")),
    ("lost", ("lost", "dropped", "missed")),
    ("refused", ("refused", "malformed")),
)
KINDS = tuple(kind for kind, _ in _KINDS)
MOST = 80  # counters that are shown
NOTHING: Mapping[str, int] = MappingProxyType({})


class CounterRow(NamedTuple):
    """One counter: kind (or empty), who counts, its name in words, its count."""

    kind: str
    who: str
    name: str
    total: int


def tallies(
    states: Iterable[MasterState | SlaveState | None], own: Mapping[str, int] = NOTHING
) -> list[CounterRow]:
    """The counters of both ends, and those of who listens, that have counted anything: by kind, the largest
    first.
    """
    found = [each for state in states if state is not None for each in _of(_who(state), state.counters)]
    found += _of("page", own)
    order = {kind: index for index, kind in enumerate((*KINDS, ""))}
    return sorted(found, key=lambda each: (order[each.kind], -each.total, each.name))[:MOST]


def totals(found: Iterable[CounterRow]) -> dict[str, int]:
    sums = dict.fromkeys(KINDS, 0)
    for each in found:
        if each.kind:
            sums[each.kind] += each.total
    return sums


def _who(state: MasterState | SlaveState) -> str:
    return "master" if isinstance(state, MasterState) else "slave"


def _of(who: str, counters: Mapping[str, int]) -> Iterator[CounterRow]:
    for name, count in counters.items():
        if count:
            yield CounterRow(_kind(name), who, printable(name).replace("_", " "), count)


def _kind(name: str) -> str:
    return next((kind for kind, marks in _KINDS if any(mark in name for mark in marks)), "")
