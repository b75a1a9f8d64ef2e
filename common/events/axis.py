"""Events of one axis, alike on master and slave."""

from collections.abc import Hashable, Mapping
from threading import Lock
from typing import Generic, TypeVar

from forefeel.common.bus import Bus
from forefeel.common.events.console import Notices
from forefeel.common.events.sink import HALTED, UNASKED, Detail, EventSink, peer
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import FOLLOWING, MOST_QUANTITY, Handshake, LimitEvent, SafetyState, within
from forefeel.common.topics import Topic

_LIMIT_NS = 100_000_000  # least time between two events of one rule
# least time between two log lines of one name
_REPEAT_NS = 1_000_000_000

K = TypeVar("K", bound=Hashable)
E = TypeVar("E")


class EventCoalescer(Generic[K, E]):
    """Passes on the first event of a key at once, then one per interval with the count. Any thread adds, one
    drains. Memory grows with the number of keys.

    Args:
        interval_ns: least time between two events of one key that are passed on.

    Attributes:
        total: number of events added, of all keys.
    """

    def __init__(self, interval_ns: int) -> None:
        self.total = 0
        self._interval_ns = interval_ns
        self._lock = Lock()
        self._open: dict[K, tuple[K, E, int]] = {}
        self._passed_ns: dict[K, int] = {}

    def add(self, key: K, event: E, count: int = 1) -> None:
        with self._lock:
            _, first, before = self._open.get(key, (key, event, 0))
            self._open[key] = key, first, before + count
            self.total += count

    def drain(self, now_ns: int, last: bool = False) -> list[tuple[K, E, int]]:
        """Removes and returns what is due, or all with `last`: key, first event since its last return, number
        of these. A key is due at once the first time, then `interval_ns` after its last return.
        """
        if not self._open:
            return []
        with self._lock:
            newest_ns = now_ns - self._interval_ns
            due = [key for key in self._open if last or self._passed_ns.get(key, newest_ns) <= newest_ns]
            self._passed_ns.update(dict.fromkeys(due, now_ns))
            return [self._open.pop(key) for key in due]


RepeatedEvents = EventCoalescer[tuple[str, str], dict[str, Detail]]
"""Repeated log lines: event and what it is counted by, details."""
Transition = tuple[SafetyState, str, SafetyState, str]
"""Transition of the safety state machine: before, event, after, reason."""


class AxisEvents:
    """Limit events for the network and safety events for the log, added by any thread. `publish` and `write`,
    called on asyncio, send them on, repeated ones coalesced.

    Attributes:
        limits: interventions and refusals, on their way to the network.
        notices: lines for the console.
    """

    def __init__(self, bus: Bus, limit: Topic[LimitEvent], event_sink: EventSink, axis: str) -> None:
        self.limits: EventCoalescer[str, LimitHit] = EventCoalescer(_LIMIT_NS)
        self.notices = Notices()
        self._event_sink, self._axis = event_sink, axis
        self._limit = bus.publisher(limit)
        self._repeated: RepeatedEvents = EventCoalescer(_REPEAT_NS)
        self._payloads: dict[str, int] = {}
        self._session: int | None = None
        self._loss_noticed = False

    def limit(self, hit: LimitHit) -> None:
        self.limits.add(hit.rule, hit)

    def session_answered(self, handshake: Handshake, opened: bool, refused: str | None, now_ns: int) -> None:
        """Logs the answer to the other end's handshake: why it was `refused` (coalesced), or that a session
        opened; nothing for a repeated handshake of an open session.
        """
        if refused is not None:
            self._repeat("session_refused", "handshake", **{**peer(handshake), "reason": refused})
        elif opened:
            self._session = handshake.session_id
            self._note("session_opened", now_ns, **peer(handshake))

    def session_lost(self, reason: str, now_ns: int) -> bool:
        """Logs the end of the session and returns True; False, and no effect, where there was none."""
        session, self._session = self._session, None
        if session is not None:
            self._note("session_lost", now_ns, session=session, reason=reason)
        return session is not None

    def publish(self, session_id: int, now_ns: int, last: bool = False) -> None:
        """Publishes a LimitEvent, with the count since the last one, for each rule that is due (once in 0.1
        s), or for all with `last`; calls `_limited` before each. Clips values to the message's range.
        """
        for _, hit, count in self.limits.drain(now_ns, last):
            self._limited(hit, count, now_ns)  # first: what can not be published is written down all the same
            # a number of a command may be 2^63
            asked, applied = (within(value, MOST_QUANTITY) for value in (hit.requested, hit.applied))
            header = self._limit.header(session_id, now_ns)
            self._limit.send(
                LimitEvent(
                    **header, rule=hit.rule, requested=asked, applied=applied, unit=hit.unit, count=count
                )
            )

    def write(self, malformed: Mapping[str, int], now_ns: int, last: bool = False) -> None:
        """Logs the repeated events that are due, or all with `last`; adds a notice, once, if the event log
        has lost lines. `malformed`: such payloads so far, by topic; new ones are logged, too.
        """
        for topic, count in malformed.items():
            new = count - self._payloads.get(topic, 0)
            if new:
                self._payloads[topic] = count
                self._repeat("malformed", topic, new)
        if self._event_sink.lost and not self._loss_noticed:
            self._loss_noticed = True
            self.notices.add("event log: lines are lost; is the disk full?")
        self._drain(self._repeated, now_ns, last)

    def _limited(self, hit: LimitHit, count: int, now_ns: int) -> None:
        """Does nothing; a subclass reports a limit that is published elsewhere, too."""

    def _note(self, event: str, now_ns: int, /, **details: Detail) -> None:
        self._event_sink.note(event, now_ns, self._axis, **details)

    def _repeat(self, event: str, name: str, count: int = 1, /, **details: Detail) -> None:
        """Adds an event that may come in floods; `write` logs it, coalesced by event and `name`."""
        self._repeated.add((event, name), details, count)

    def _drain(self, coalescer: RepeatedEvents, now_ns: int, last: bool) -> None:
        for (event, name), details, count in coalescer.drain(now_ns, last):
            self._note(event, now_ns, name=name, count=count, **details)

    def _transition(self, entry: str, transition: Transition, session: int, now_ns: int) -> None:
        """Logs a safety transition as the event `entry`; requests a flight record where it enters FAULT or
        ESTOPPED, or leaves a following state by an event of `UNASKED`.
        """
        before, event, after, reason = transition
        self._note(
            entry, now_ns,
            before=before.value, event=str(event), after=after.value, reason=reason, session=session,
        )  # fmt: skip
        if after in HALTED or (before in FOLLOWING and event in UNASKED):
            self._event_sink.flight(self._axis, str(event), reason, now_ns)
