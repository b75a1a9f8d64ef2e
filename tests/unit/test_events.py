"""What happens on an axis: coalesced, worded, published, and told at the console."""

from itertools import pairwise
from typing import Any

import pytest

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock import VirtualClock
from forefeel.common.events.axis import EventCoalescer
from forefeel.common.events.console import Notices, tell_notices
from forefeel.common.events.sink import NULL_EVENT_SINK
from forefeel.common.events.text import event_text, gap, span
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import Message
from forefeel.common.transport.memory import MemoryBus
from forefeel.master.events import MasterEvents
from tests.messages import usual
from tests.network import AXIS, CELL, Party
from tests.unit.failing import refusing

MS = 1_000_000
S = 1000 * MS


# --- coalescer ---


def test_the_first_of_a_key_is_told_at_once_then_the_first_of_each_interval_with_the_count() -> None:
    coalescer: EventCoalescer[str, int] = EventCoalescer(100 * MS)
    told = []
    coalescer.add("range", 0)
    assert coalescer.drain(0) == [("range", 0, 1)]  # keys do not wait for each other
    for ms in range(250):
        coalescer.add("late", ms)
        told += coalescer.drain(ms * MS)
    told += coalescer.drain(250 * MS, last=True)
    assert told == [("late", 0, 1), ("late", 1, 100), ("late", 101, 100), ("late", 201, 49)]
    assert coalescer.total == 251
    assert coalescer.drain(S, last=True) == []


# --- text ---


def test_an_end_that_was_silent_between_two_states_is_told_by_its_own_clock() -> None:
    stamps_ms = [*range(0, 1000, 20), 1480, 3480, 3500]
    states = [None, *(usual(topics.SLAVE_STATE, stamp_ns=ms * MS) for ms in stamps_ms)]
    told = [gap(topics.SLAVE_STATE, before, state) for before, state in pairwise(states) if state is not None]
    assert {i: text for i, text in enumerate(told) if text} == {
        stamps_ms.index(3480): f"slave was silent for {span(2.0)}"
    }
    assert (
        gap(
            topics.EMERGENCY_STOP,
            usual(topics.EMERGENCY_STOP, stamp_ns=0),
            usual(topics.EMERGENCY_STOP, stamp_ns=S),
        )
        == ""
    )


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (usual(topics.SAFETY_EVENT, reason="no command"), ("armed -> stopping", "watchdog", "no command")),
        (usual(topics.LIMIT_EVENT, count=3), ("velocity", "300 mm/s", "200 mm/s", "3 times")),
        (
            usual(topics.LIMIT_EVENT, rule="round_trip", requested=0.812, applied=0.7, unit="s"),
            ("812 ms", "700 ms"),
        ),
        (usual(topics.EMERGENCY_STOP, source="x"), ("emergency stop", "x", "pressed")),
        (usual(topics.SLAVE_STATE), ()),
    ],
)
def test_event_text_has_its_figures(event: Message, words: tuple[str, ...]) -> None:
    text = event_text(event)
    assert all(word in text for word in words)
    assert bool(text) == bool(words)


def test_span_has_the_unit_of_its_size() -> None:
    assert [span(s).split()[-1] for s in (-1, 48.9, 125, 4020)] == ["s", "s", "s", "min"]
    assert span(125).startswith("2 min 05") and span(4020).startswith("1 h 07")


# --- console ---


def test_a_notice_is_one_printable_line_and_very_many_keep_the_newest() -> None:
    notices = Notices()
    notices.add("a\nb\x1b[2J")
    assert notices.drain() == ["a?b?[2J"]
    assert notices.drain() == []
    for i in range(1000):
        notices.add(str(i))
    assert notices.drain()[-1] == "999"


def test_a_cause_that_lasts_is_told_at_once_and_every_five_seconds() -> None:
    notices = Notices()
    for at_s in range(3, 20):
        notices.repeat(str(at_s), at_s * S)
    assert notices.drain() == ["3", "8", "13", "18"]


def test_a_terminal_that_is_gone_stops_nothing() -> None:
    notices = Notices()
    notices.add("a")
    tell_notices("slave", {"insertion": notices}, refusing(BrokenPipeError()))
    assert notices.drain() == []


# --- the master ---


class Rig(Party):
    """The events of a master, and a slave whose messages a test writes."""

    def __init__(self) -> None:
        super().__init__(MemoryBus(), VirtualClock())
        bus = Bus(self.network.session(self.clock), CELL, AXIS, self.clock)
        self.events = MasterEvents(bus, NULL_EVENT_SINK, AXIS)


def test_a_change_of_how_the_master_stands_is_one_event() -> None:
    rig = Rig()
    rig.events.publish_status("no_session", "no answer", 7, 0)
    rig.events.publish_status("in_session", "accepted", 7, 50 * MS)
    rig.events.publish_status("in_session", "accepted", 7, 100 * MS)
    rig.events.publish_status("handle_fault", "x" * 1000, 7, 150 * MS)
    told = [
        (t.before, t.event, t.after, len(t.reason), t.session_id) for t in rig.messages(topics.MASTER_EVENT)
    ]
    assert told == [
        ("no_session", "session_opened", "in_session", 8, 7),
        ("in_session", "handle_fault", "handle_fault", 256, 7),
    ]


def test_limits_of_the_force_are_published_with_their_count() -> None:
    rig = Rig()
    for tick in range(1000):
        rig.events.limit(LimitHit("rendered_force", 9.0, 4.0, "N"))
        rig.events.publish(1, tick * MS, last=tick == 999)
    limits = rig.messages(topics.MASTER_LIMIT)
    assert len(limits) == 11
    assert sum(event.count for event in limits) == 1000 == rig.events.counts()["force_limited"]
    assert limits[0].model_dump(include=set(LimitHit._fields)) == {
        "rule": "rendered_force", "requested": 9.0, "applied": 4.0, "unit": "N",
    }  # fmt: skip


def test_the_slaves_limits_are_counted_by_rule_and_its_transitions_told_each_once() -> None:
    rig = Rig()
    for rule, count in (("force", 3), ("force", 4), ("late", 5)):
        rig.send(
            topics.LIMIT_EVENT, rig.say(topics.LIMIT_EVENT, 1, rule=rule, count=count)
        )  # doubled on the way
    moved: dict[str, Any] = {"before": "ready", "event": "engage", "after": "engaging", "reason": "pressed"}
    for _ in range(2):
        rig.send(topics.SAFETY_EVENT, rig.say(topics.SAFETY_EVENT, 1, **moved))
    for _ in range(8):
        rig.clock.set_ns(rig.now_ns + S)
        rig.say(topics.LIMIT_EVENT, 1, rule="round_trip", requested=0.812, applied=0.7, unit="s", count=9)
    slow = ["slave not armed: round trip 812 ms, limit 700 ms"] * 2  # in 8 s, every 5 s
    assert rig.events.counts() == {
        "limit_force": 7, "limit_late": 5, "limit_round_trip": 72, "force_limited": 0,
        "event_lines_lost": 0,
    }  # fmt: skip
    assert rig.events.notices.drain() == ["slave ready -> engaging, engage: pressed"] * 2 + slow
