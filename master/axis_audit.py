"""What one axis of the master leaves behind: entries of the audit log, and triggers of flight records."""

from forefeel.common.audit_sink import REFUSALS, AuditSink, EventCoalescer, Malformed, peer, worth_a_record
from forefeel.common.bus import Bus
from forefeel.common.messages import Handshake, LimitEvent, SafetyEvent
from forefeel.common.notices import Notices


class MasterAxisAudit:
    """Any thread notes; `serve` says on asyncio what was gathered."""

    def __init__(self, audit_sink: AuditSink, axis: str) -> None:
        self._audit_sink, self._axis = audit_sink, axis
        self._tally = EventCoalescer()
        self._malformed = Malformed(self._tally)
        self._open_session: int | None = None
        self._handle_fault: str | None = None
        self._problem: str | None = None

    def slave_event(self, event: SafetyEvent, now_ns: int) -> None:
        """A transition of the slave, as it was heard."""
        self._audit_sink.note(
            "slave_safety", now_ns, self._axis,
            before=event.before.value, event=event.event, after=event.after.value,
            reason=event.reason, session=event.session_id,
        )  # fmt: skip
        if worth_a_record(event.before, event.event, event.after):
            self._audit_sink.flight(self._axis, event.event, event.reason, now_ns)

    def slave_limit(self, event: LimitEvent) -> None:
        """What the slave refused."""
        if event.rule in REFUSALS:
            self._tally.add("slave_refused", event.rule, event.count)

    def answered(self, handshake: Handshake, opened: bool, accepted: bool, reason: str, now_ns: int) -> None:
        """The slave's answer to a handshake."""
        if opened:
            self._open_session = handshake.session_id
            self._audit_sink.note("session_opened", now_ns, self._axis, **peer(handshake))
        elif not accepted:
            self._tally.add("session_refused", "handshake", 1, **{**peer(handshake), "reason": reason})

    def session_lost(self, now_ns: int, reason: str) -> None:
        """The session is not open any more; said once. Nobody else heard what the hand felt."""
        session, self._open_session = self._open_session, None
        if session is not None:
            self._audit_sink.note("session_lost", now_ns, self._axis, session=session, reason=reason)
            self._audit_sink.flight(self._axis, "session_lost", reason, now_ns)

    def stop_asked(self, now_ns: int, by: str, reason: str) -> None:
        """The person asked for an emergency stop."""
        self._audit_sink.note("emergency_stop", now_ns, self._axis, by=by, reason=reason)

    def last_words(self, now_ns: int) -> None:
        """What was gathered and not said yet, at the end."""
        self._tally.drain(self._audit_sink, now_ns, self._axis, last=True)

    def serve(self, now_ns: int, bus: Bus, handle_fault: str | None, notices: Notices) -> None:
        """Says what was gathered; about every 50 ms."""
        if handle_fault is not None and self._handle_fault is None:
            self._audit_sink.note("device_fault", now_ns, self._axis, name="handle", reason=handle_fault)
            self._audit_sink.flight(self._axis, "handle_fault", handle_fault, now_ns)
        self._handle_fault = handle_fault
        problem = self._audit_sink.problem(now_ns)
        if problem is not None and self._problem is None:
            notices.add(f"{problem}; what happens is not written down")
        self._problem = problem
        self._malformed.counted(dict(bus.malformed))
        self._tally.drain(self._audit_sink, now_ns, self._axis)
