"""Events of one axis of the master, and the slave's events that it receives."""

from collections import Counter, deque
from typing import Literal

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.events.axis import AxisEvents
from forefeel.common.events.sink import REFUSALS, EventSink
from forefeel.common.events.text import CONTACT_LOST, DISTRUSTED, ROUND_TRIP, emergency_stop, event_text
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import LimitEvent, MasterEvent, SafetyEvent

AxisStatus = Literal["no_session", "in_session", "handle_fault", "failed"]
_EVENTS: dict[AxisStatus, str] = {
    "no_session": "session_lost",
    "in_session": "session_opened",
    "handle_fault": "handle_fault",
    "failed": "fault",
}
_MOST_RULES = 64  # counters of the slave's rules: five times those that there are
_REMEMBERED_EVENTS = 64  # events by which a doubled one is known


class MasterEvents(AxisEvents):
    """Publishes and logs the master's events; counts and logs the slave's, a doubled one once."""

    def __init__(self, bus: Bus, event_sink: EventSink, axis: str) -> None:
        super().__init__(bus, topics.MASTER_LIMIT, event_sink, axis)
        self._counters: Counter[str] = Counter()
        self._event = bus.publisher(topics.MASTER_EVENT)
        self._status: AxisStatus = "no_session"
        self._handle_fault: str | None = None
        self._received: deque[tuple[bool, int, int]] = deque(maxlen=_REMEMBERED_EVENTS)
        bus.subscribe(topics.LIMIT_EVENT, self._on_limit)
        bus.subscribe(topics.SAFETY_EVENT, self._on_safety)

    def _on_limit(self, event: LimitEvent, receive_ns: int) -> None:
        """Adds a slave's event's `count` to the counter of its rule (`limit_<rule>`; beyond 64 names
        `limit_other`), logs refusals and adds a notice for a long round trip. Ignores one received before.
        """
        if not self._is_new(event):
            return
        counter = f"limit_{event.rule}"
        if counter not in self._counters and len(self._counters) >= _MOST_RULES:
            counter = "limit_other"
        self._counters[counter] += event.count
        if event.rule in REFUSALS:
            self._repeat("slave_refused", event.rule, event.count)
        if event.rule == ROUND_TRIP:
            self.notices.repeat(f"slave {event_text(event)}", receive_ns)

    def _on_safety(self, event: SafetyEvent, receive_ns: int) -> None:
        if self._is_new(event):
            self.notices.add(f"slave {event_text(event)}")
            transition = event.before, event.event, event.after, event.reason
            self._transition("slave_safety", transition, event.session_id, receive_ns)

    def _is_new(self, event: LimitEvent | SafetyEvent) -> bool:
        key = (type(event) is LimitEvent, event.sequence, event.stamp_ns)
        new = key not in self._received
        self._received.append(key)
        return new

    def _limited(self, hit: LimitHit, count: int, now_ns: int) -> None:
        """Logs a distrusted prediction, with a notice, and adds a notice for a lost contact; does nothing for
        any other rule. `count`: occurrences since the last call for this rule.
        """
        if hit.rule == DISTRUSTED:
            self._repeat("prediction_distrusted", "rendering", count)
            self.notices.repeat(
                "prediction out of reach of the measured force, which is felt late now", now_ns
            )
        elif hit.rule == CONTACT_LOST:
            self.notices.add("the wall gave way: what was learned of it is forgotten")

    def session_lost(self, reason: str, now_ns: int) -> bool:
        """Logs the end of the session and asks for a flight record, for nobody else received what the hand
        felt. True then; False where no session was open.
        """
        lost = super().session_lost(reason, now_ns)
        if lost:
            self._event_sink.flight(self._axis, "session_lost", reason, now_ns)
        return lost

    def stop_asked(self, by: str, reason: str, now_ns: int) -> None:
        self._note("emergency_stop", now_ns, by=by, reason=reason)
        self.notices.add(emergency_stop(by, reason))

    def clock_step(self, topic: str, step_s: float, now_ns: int) -> None:
        """Counts and logs a step of the slave's stamps, and adds a notice."""
        self._counters["clock_steps"] += 1
        self._repeat("clock_step", topic, step_s=step_s)
        self.notices.repeat(
            f"{topic}: stamps stepped by {step_s:+.3g} s: the slave's clock was set, or the way is faster",
            now_ns,
        )

    def publish_status(self, status: AxisStatus, reason: str, session_id: int, now_ns: int) -> None:
        """Publishes a `MasterEvent` where the status is another than at the last call; else nothing."""
        before, self._status = self._status, status
        if before != status:
            header = self._event.header(session_id, now_ns)
            event = _EVENTS[status]
            self._event.send(
                MasterEvent(**header, before=before, event=event, after=status, reason=reason[:256])
            )

    def check(self, handle_fault: str | None, now_ns: int) -> None:
        """Logs a fault of the handle when it begins, and asks for a flight record."""
        if handle_fault is not None and self._handle_fault is None:
            self._note("device_fault", now_ns, name="handle", reason=handle_fault)
            self._event_sink.flight(self._axis, "handle_fault", handle_fault, now_ns)
        self._handle_fault = handle_fault

    def counts(self) -> dict[str, int]:
        """Counts by name: slave's limit events by rule, clock steps, limited forces, lines the log lost."""
        lost = self._event_sink.lost
        return {**self._counters, "force_limited": self.limits.total, "event_lines_lost": lost}
