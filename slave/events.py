"""Events of one axis of the slave: transitions, limits, faults; and cycles for the flight recorder."""

from collections.abc import Mapping

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.events.axis import AxisEvents, EventCoalescer, RepeatedEvents, Transition
from forefeel.common.events.sink import REFUSALS, SAFETY, EventSink
from forefeel.common.events.text import OVER_LIMIT, event_text, notable
from forefeel.common.flight import CycleRow
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import Grip, SafetyEvent, SafetyState
from forefeel.common.slots import BoundedQueue
from forefeel.slave.control import ControlOutputs
from forefeel.slave.devices import DeviceWatch

_STOP_NS = 1_000_000_000  # ns within which one stop is repeated: every 250 ms or more often
_MINUTE_NS = 60_000_000_000  # ns in a minute, the interval of what fails at every tick


class SlaveEvents(AxisEvents):
    """Adds the safety state machine, the devices and the flight recorder's cycles to `AxisEvents`."""

    def __init__(self, bus: Bus, event_sink: EventSink, cell: str, axis: str) -> None:
        super().__init__(bus, topics.LIMIT_EVENT, event_sink, axis)
        self._safety = bus.publisher(topics.SAFETY_EVENT)
        self._transitions: BoundedQueue[tuple[Transition, int]] = BoundedQueue(256)
        self._stop_taken_ns = 0
        self._faults: RepeatedEvents = EventCoalescer(_MINUTE_NS)
        key = topics.CONTROL_CYCLE.key(cell, axis)
        self._add_cycle = event_sink.rings.ring(key).add if event_sink.rings is not None else None

    def counts(self) -> dict[str, int]:
        return {
            "events_dropped": self._transitions.dropped,
            "event_lines_lost": self._event_sink.lost,
            "limit_interventions": self.limits.total,
        }

    def transition(self, transition: Transition, session: int, now_ns: int) -> None:
        """Logs a transition at once and queues it for `publish`; called by the control loop."""
        self._transitions.put((transition, now_ns))
        self._transition(SAFETY, transition, session, now_ns)

    def stop_asked(self, by: str, reason: str) -> None:
        self._repeat("emergency_stop", "any", by=by, reason=reason)

    def stop_taken(self, reason: str, stopped: bool, now_ns: int) -> None:
        """Adds a notice for a stop of an axis that is `stopped` already, which is no transition; none within
        1 s after another stop, for who sends one repeats it.
        """
        if stopped and now_ns - self._stop_taken_ns > _STOP_NS:
            self.notices.add(f"stopped already; emergency stop: {reason}")
        self._stop_taken_ns = now_ns

    def device_fault(self, device: str, reason: str) -> None:
        self._faults.add(("device_fault", device), {"reason": reason})

    def cycle(
        self,
        now_ns: int,
        outputs: ControlOutputs,
        watch: DeviceWatch,
        grip: Grip,
        state: SafetyState,
        session: int,
    ) -> None:
        """Adds the row of one control cycle to the flight recorder's ring, if there is a recorder."""
        if self._add_cycle is None:
            return
        executing = outputs.executing
        row = CycleRow(
            now_ns, outputs.target_m, outputs.velocity_m_s, outputs.moving, *watch.stage,
            watch.force.force_n, watch.force.valid, state, grip,
            None if executing is None else executing.sequence, session,
        )  # fmt: skip
        self._add_cycle(row)

    def publish(self, session_id: int, now_ns: int, last: bool = False) -> None:
        """Publishes the queued transitions, each with a notice, then the limits that are due, `last`: all."""
        for (before, event, after, reason), stamp_ns in self._transitions.drain():
            header = self._safety.header(session_id, stamp_ns)
            message = SafetyEvent(**header, before=before, event=str(event), after=after, reason=reason[:256])
            self._safety.send(message)
            self.notices.add(event_text(message))
        super().publish(session_id, now_ns, last)

    def _limited(self, hit: LimitHit, count: int, now_ns: int) -> None:
        """Logs a refused command and a force above its limit; adds a notice for a rule that the console is to
        show (`notable`). `count`: occurrences since the last call for this rule.
        """
        if hit.rule in REFUSALS:
            asked, limit = (f"{value:g} {hit.unit}".strip() for value in (hit.requested, hit.applied))
            self._repeat("refused", hit.rule, count, requested=asked, limit=limit)
        if hit.rule == OVER_LIMIT:
            self._repeat(OVER_LIMIT, "any", count, force_n=hit.requested, limit_n=hit.applied)
        if text := notable(hit.rule, hit.requested, hit.applied):
            self.notices.repeat(text, now_ns)

    def write(self, malformed: Mapping[str, int], now_ns: int, last: bool = False) -> None:
        super().write(malformed, now_ns, last)
        self._drain(self._faults, now_ns, last)
