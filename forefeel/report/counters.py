"""What was counted in a run, as one flat table of integers."""

from collections import Counter
from collections.abc import Iterable
from typing import TypeVar

from forefeel.common.messages import MasterState, Message, SlaveState
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import (
    LIMIT_EVENT,
    MASTER_IMPAIRMENT,
    MASTER_STATE,
    SAFETY_EVENT,
    SLAVE_IMPAIRMENT,
    SLAVE_STATE,
)

M = TypeVar("M", bound=Message)
_ROLES = (("master", MASTER_IMPAIRMENT), ("slave", SLAVE_IMPAIRMENT))


def last(messages: Iterable[M]) -> M | None:
    """The message that arrived last, None without any."""
    found = None
    for found in messages:  # noqa: B007 - wanted is what the loop leaves behind
        pass
    return found


def axis_counters(run: Run, axis: str) -> dict[str, int]:
    """Both ends' counters as published last, stops, limit events by rule, safety events by name; sorted."""
    counts: Counter[str] = Counter()
    for event in run.messages(axis, LIMIT_EVENT):
        counts[f"limit_{event.rule}"] += event.count
    for transition in run.messages(axis, SAFETY_EVENT):
        counts[f"safety_{transition.event}"] += 1
    slave = last(run.messages(axis, SLAVE_STATE))
    for role, state in ("slave", slave), ("master", last(run.messages(axis, MASTER_STATE))):
        counts.update(_prefixed(role, state))
    if slave:
        counts["stops"] = slave.stops
    return dict(sorted(counts.items()))


def _prefixed(role: str, state: SlaveState | MasterState | None) -> dict[str, int]:
    return {f"{role}_{name}": count for name, count in state.counters.items()} if state else {}


def recorder_counters(run: Run) -> dict[str, int]:
    """What the recorder heard and could not write, where it said so."""
    said = run.metadata.get("recorder", {})
    return {f"recorder_{name}": int(n) for name, n in sorted(said.items()) if n.isdecimal()}


def impairment_counters(run: Run) -> dict[str, int]:
    """Messages that passed each impaired link, and how many of them it dropped, duplicated or delayed on
    purpose; sorted.
    """
    counts: Counter[str] = Counter()
    for role, topic in _ROLES:
        for part in (part for axis in run.axes for part in run.messages(axis, topic)):
            name = f"impairment_{role}_{part.link}"
            copies = [len(delays_ns) for delays_ns in part.delays_ns]
            counts[f"{name}_messages"] += len(copies)
            counts[f"{name}_dropped"] += copies.count(0)
            counts[f"{name}_duplicated"] += sum(n > 1 for n in copies)
            counts[f"{name}_delayed"] += sum(any(delays_ns) for delays_ns in part.delays_ns)
    return dict(sorted(counts.items()))
