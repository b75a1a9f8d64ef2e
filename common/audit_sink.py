"""What a daemon leaves behind of itself: a port, and the one that keeps nothing.

`forefeel.common.state` keeps it.
"""

from collections.abc import Mapping
from threading import Lock

from forefeel.common.audit import ChainEnd, Detail
from forefeel.common.flight import Rings
from forefeel.common.messages import FOLLOWING, Handshake, SafetyState

# ns, least time between two entries of one name; chosen, not measured: shorter fills the log faster in a
# flood, longer tells of a flood's end later
_ENTRY_INTERVAL_NS = 1_000_000_000

HALTED = frozenset({SafetyState.FAULT, SafetyState.ESTOPPED})
UNASKED = frozenset({"watchdog", "session_lost", "misaligned", "round_trip"})
"""Events that end a motion without the person's wish."""

REFUSALS = frozenset({"session", "sequence", "late", "future", "range", "alignment", "round_trip"})
"""Rules by which a command is refused; the others change a motion, and stand in the recording."""


def worth_a_record(before: SafetyState, event: str, after: SafetyState) -> bool:
    """Whether a flight record is kept of a transition: whatever halts, or ends a motion unasked."""
    return after in HALTED or (before in FOLLOWING and event in UNASKED)


def peer(handshake: Handshake) -> dict[str, Detail]:
    """Who the other end is, for an entry about a session."""
    return {
        "session": handshake.session_id,
        "peer": handshake.instance_id,
        "software": handshake.software,
        "settings": handshake.settings_hash,
        "drivers": dict(handshake.drivers),
    }


class AuditSink:
    """The audit log and the flight recorder as loops see them: no call blocks, any thread may call.

    This one keeps nothing, for simulations in virtual time.

    Attributes:
        rings: what the flight recorder holds in memory; None where there is none.
        latched: axes whose emergency stop, or fault of a motion, outlived the daemon before, with its reason.
    """

    rings: Rings | None = None
    latched: Mapping[str, str] = {}

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        """One entry of the audit log, with the wall clock of now."""

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        """Asks for a record of what led to this and of half a second after it."""

    def head(self) -> ChainEnd | None:
        """The end of the audit log, for the log of the other end; None where there is no log."""
        return None

    def kept(self, axis: str) -> bool:
        """Whether what is latched of the axis would be found by a new start: it is on the disk."""
        del axis
        return True

    def problem(self, now_ns: int) -> str | None:
        """Why something that has to be kept can not be written, if it can not."""
        del now_ns
        return None


NULL_AUDIT_SINK = AuditSink()


class EventCoalescer:
    """Gathers what may come in floods: the first of a name at once, then one entry per interval with the
    count; none uncounted. Any thread adds, one drains.
    """

    def __init__(self, interval_ns: int = _ENTRY_INTERVAL_NS) -> None:
        self._interval_ns = interval_ns
        self._lock = Lock()
        self._open: dict[tuple[str, str], tuple[int, dict[str, Detail]]] = {}
        self._said_ns: dict[tuple[str, str], int] = {}

    def add(self, event: str, name: str, count: int = 1, /, **details: Detail) -> None:
        """`name`: what it is counted by, from a bounded set; the first details of an entry stand for all."""
        key = event, name
        with self._lock:
            before, first = self._open.get(key, (0, details))
            self._open[key] = before + count, first

    def drain(self, audit_sink: AuditSink, now_ns: int, axis: str, last: bool = False) -> None:
        """Notes what is due; with `last` all there is."""
        if not self._open:
            return
        with self._lock:
            due = [
                key
                for key in self._open
                if last or now_ns - self._said_ns.get(key, now_ns - self._interval_ns) >= self._interval_ns
            ]
            said = [(key, *self._open.pop(key)) for key in due]
            self._said_ns.update(dict.fromkeys(due, now_ns))
        for (event, name), count, details in said:
            audit_sink.note(event, now_ns, axis, name=name, count=count, **details)


class Malformed:
    """Payloads that were no message of their topic, as they are counted by a bus, into a tally."""

    def __init__(self, tally: EventCoalescer) -> None:
        self._tally = tally
        self._said: dict[str, int] = {}

    def counted(self, counts: Mapping[str, int]) -> None:
        """The counts of now, by topic."""
        for topic, count in counts.items():
            new = count - self._said.get(topic, 0)
            if new:
                self._said[topic] = count
                self._tally.add("malformed", topic, new)
