"""What one axis of the slave leaves behind: audit entries, cycles and triggers of flight records."""

from forefeel.common import topics
from forefeel.common.audit import SAFETY
from forefeel.common.audit_sink import REFUSALS, AuditSink, EventCoalescer, Malformed, peer, worth_a_record
from forefeel.common.bus import Bus
from forefeel.common.flight import CycleRow
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import Grip, Handshake, SafetyState
from forefeel.slave.control import ControlOutputs, Transition
from forefeel.slave.devices import DeviceWatch

_MINUTE_NS = 60_000_000_000  # ns in a minute


class SlaveAxisAudit:
    """Any thread notes; `serve` says on asyncio what was gathered."""

    def __init__(self, audit_sink: AuditSink, cell: str, axis: str) -> None:
        self._audit_sink, self._axis = audit_sink, axis
        self._tally = EventCoalescer()
        self._faults = EventCoalescer(_MINUTE_NS)  # a device that stays broken fails at every tick
        self._malformed = Malformed(self._tally)
        self._live = False
        key = topics.CONTROL_CYCLE.key(cell, axis)
        self._add_cycle = audit_sink.rings.ring(key).add if audit_sink.rings is not None else None

    def cycle(
        self,
        now_ns: int,
        outputs: ControlOutputs,
        watch: DeviceWatch,
        grip: Grip,
        state: SafetyState,
        session: int,
    ) -> None:
        """One control cycle: a tuple, and nothing else."""
        if self._add_cycle is None:
            return
        executing = outputs.executing
        row: CycleRow = (
            now_ns, outputs.target_m, outputs.velocity_m_s, outputs.moving, *watch.stage,
            watch.force.force_n, watch.force.valid, state, grip,
            None if executing is None else executing.sequence, session,
        )  # fmt: skip
        self._add_cycle(row)

    def transition(self, now_ns: int, transition: Transition, session: int) -> None:
        """A transition of the safety state machine, from the loop itself."""
        before, event, after, reason = transition
        self._audit_sink.note(
            SAFETY, now_ns, self._axis,
            before=before.value, event=event.value, after=after.value, reason=reason, session=session,
        )  # fmt: skip
        if worth_a_record(before, event, after):
            self._audit_sink.flight(self._axis, event.value, reason, now_ns)

    def stop_asked(self, by: str, reason: str) -> None:
        """Somebody asked for an emergency stop."""
        self._tally.add("emergency_stop", "any", by=by, reason=reason)

    def device_fault(self, device: str, reason: str) -> None:
        """A device failed."""
        self._faults.add("device_fault", device, reason=reason)

    def limits(self, hit: LimitHit, count: int) -> None:
        """Interventions of one rule; only what was refused is said here, the others are in the recording."""
        if hit.rule in REFUSALS:
            asked = f"{hit.requested:g} {hit.unit}".strip()
            limit = f"{hit.applied:g} {hit.unit}".strip()
            self._tally.add("refused", hit.rule, count, requested=asked, limit=limit)

    def answered(self, now_ns: int, handshake: Handshake, reason: str, session_before: int) -> None:
        """A handshake was answered; `reason`: why it was refused, or empty."""
        if reason:
            self._tally.add("session_refused", "handshake", 1, **{**peer(handshake), "reason": reason})
        elif handshake.session_id != session_before:
            self._live = True
            self._audit_sink.note("session_opened", now_ns, self._axis, **peer(handshake))

    def serve(self, now_ns: int, bus: Bus, session: int, lost: str, last: bool = False) -> None:
        """Says what was gathered, and that a session was lost; about every 10 ms. `lost`: why there is none,
        empty while there is one.
        """
        if self._live and lost:
            self._audit_sink.note("session_lost", now_ns, self._axis, session=session, reason=lost)
        self._live = not lost
        self._malformed.counted({**dict(bus.malformed), **bus.refused})
        for tally in (self._tally, self._faults):
            tally.drain(self._audit_sink, now_ns, self._axis, last)
