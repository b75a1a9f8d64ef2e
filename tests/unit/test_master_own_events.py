"""The master's own limits and transitions reach the network as events."""

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock import VirtualClock
from forefeel.common.codec import decode
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import LimitEvent, MasterEvent
from forefeel.common.transport.memory import MemoryBus
from forefeel.master.own_events import OwnEvents

MS = 1_000_000


class Rig:
    def __init__(self) -> None:
        clock, memory = VirtualClock(), MemoryBus()
        self.limits: list[LimitEvent] = []
        self.transitions: list[MasterEvent] = []
        observer = memory.session(clock)
        observer.subscribe(
            topics.MASTER_LIMIT.key("c", "a"), lambda p, _: self.limits.append(decode(LimitEvent, p))
        )
        observer.subscribe(
            topics.MASTER_EVENT.key("c", "a"), lambda p, _: self.transitions.append(decode(MasterEvent, p))
        )
        self.events = OwnEvents(Bus(memory.session(clock), "c", "a", clock))


def test_a_change_is_one_event_and_standing_still_is_none() -> None:
    rig = Rig()
    rig.events.serve(0, 7, "no_link", "no answer")
    rig.events.serve(50 * MS, 7, "linked", "accepted")
    rig.events.serve(100 * MS, 7, "linked", "accepted")
    rig.events.serve(150 * MS, 7, "handle_fault", "x" * 1000)
    said = [(t.before, t.event, t.after, len(t.reason), t.session_id) for t in rig.transitions]
    assert said == [
        ("no_link", "session_opened", "linked", 8, 7),
        ("linked", "handle_fault", "handle_fault", 256, 7),
    ]


def test_limits_are_counted_and_at_most_ten_events_a_second() -> None:
    rig = Rig()
    for tick in range(1000):
        rig.events.limited((LimitHit("rendered_force", 9.0, 4.0, "N"),))
        if tick % 50 == 0:
            rig.events.serve(tick * MS, 1, "no_link", "")
    rig.events.serve(1000 * MS, 1, "no_link", "", last=True)
    assert sum(event.count for event in rig.limits) == 1000 == rig.events.counts()["force_limited"]
    assert len(rig.limits) <= 11
    assert (rig.limits[0].rule, rig.limits[0].requested, rig.limits[0].applied) == (
        "rendered_force",
        9.0,
        4.0,
    )
