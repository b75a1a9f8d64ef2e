"""What the slave says of its gate: limits are counted, safety transitions and a round trip that is too long
told to the person.
"""

from collections import Counter, deque

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.messages import LimitEvent, SafetyEvent
from forefeel.common.notices import Lasting, Notices, in_words, long_round_trip
from forefeel.master.axis_audit import MasterAxisAudit

# events by which a doubled one is known; chosen, not measured: fewer miss one that comes late
_REMEMBERED_EVENTS = 64


class SlaveEvents:
    """Hears the slave's events where the transport delivers; one that a network doubled counts once.

    Attributes:
        counters: interventions and refusals of the slave by rule.
        notices: the transitions in words, and why the slave does not arm over this link.
    """

    def __init__(self, bus: Bus, axis_audit: MasterAxisAudit) -> None:
        self.counters: Counter[str] = Counter()
        self.notices = Notices()
        self._axis_audit = axis_audit
        self._round_trip = Lasting()
        self._heard: deque[tuple[bool, int, int]] = deque(maxlen=_REMEMBERED_EVENTS)
        bus.subscribe(topics.LIMIT_EVENT, self._on_limit)
        bus.subscribe(topics.SAFETY_EVENT, self._on_safety)

    def _on_limit(self, event: LimitEvent, receive_ns: int) -> None:
        if not self._is_new(event):
            return
        self.counters[f"limit_{event.rule}"] += event.count
        self._axis_audit.slave_limit(event)
        if event.rule == "round_trip" and self._round_trip.due(receive_ns):
            self.notices.add(f"slave does not arm: {long_round_trip(event.requested, event.applied)}")

    def _on_safety(self, event: SafetyEvent, receive_ns: int) -> None:
        if self._is_new(event):
            self.notices.add(f"slave {in_words(event)}")
            self._axis_audit.slave_event(event, receive_ns)

    def _is_new(self, event: LimitEvent | SafetyEvent) -> bool:
        key = (type(event) is LimitEvent, event.sequence, event.stamp_ns)
        new = key not in self._heard
        self._heard.append(key)
        return new
