from forefeel.common import topics
from forefeel.common.audit_sink import NULL_AUDIT_SINK
from forefeel.common.bus import Bus
from forefeel.common.clock import VirtualClock
from forefeel.common.messages import LimitEvent, SafetyEvent, SafetyState
from forefeel.common.transport.memory import MemoryBus
from forefeel.master.axis_audit import MasterAxisAudit
from forefeel.master.slave_events import SlaveEvents

S = 1_000_000_000


def test_limits_are_counted_by_rule_and_transitions_told_each_once() -> None:
    network, clock = MemoryBus(), VirtualClock(0)
    events = SlaveEvents(
        Bus(network.session(clock), "cell", "insertion", clock), MasterAxisAudit(NULL_AUDIT_SINK, "insertion")
    )
    slave = Bus(network.session(clock), "cell", "insertion", clock)
    limit, safety = slave.publisher(topics.LIMIT_EVENT), slave.publisher(topics.SAFETY_EVENT)
    for rule, count in (("force", 3), ("force", 4), ("late", 5)):
        message = LimitEvent(
            **limit.header(1, 7), rule=rule, requested=1.0, applied=0.0, unit="N", count=count
        )
        limit.send(message)
        limit.send(message)  # doubled on the way
    for _ in range(2):
        header = safety.header(1, 7)
        moved = SafetyEvent(
            **header, before=SafetyState.READY, event="engage", after=SafetyState.ENGAGING, reason="pressed"
        )
        safety.send(moved)
        safety.send(moved)
    for _ in range(8):
        clock.set_ns(clock.now_ns() + S)
        header = limit.header(1, clock.now_ns())
        limit.send(LimitEvent(**header, rule="round_trip", requested=0.812, applied=0.7, unit="s", count=9))
    slow = ["slave does not arm: round trip 812 ms, limit 700 ms"] * 2  # in 8 s, every 5 s
    assert events.counters.pop("limit_round_trip") == 72
    assert events.counters == {"limit_force": 7, "limit_late": 5}
    assert events.notices.drain() == ["slave ready -> engaging, engage: pressed"] * 2 + slow
