"""Admission of the commands that the control loop takes, and the slot that keeps the newest."""

from collections import Counter
from typing import NamedTuple

from forefeel.common.events.axis import AxisEvents
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import MotionCommand
from forefeel.slave.gate import SECOND_WRITER, CommandGate, GateLimits, Refusal
from forefeel.slave.session import SlaveSession
from forefeel.slave.settings import SlaveAxisSettings

_RANGE_MARGIN_M = 0.05  # beyond the workspace by this much a position is nonsense, not merely too far
_RANGE_SPEEDS = 10.0  # times `max_velocity_m_s`, beyond which a speed is nonsense
_LATE_FOR_NS = 3_000_000_000  # commands that are late for so long are not late, the way has become longer
_SILENT_FOR_NS = 3_000_000_000  # a master that lives commands a thousand times a second
_ONLY_LATE = "commands come late all the time: a new session takes the measure of the way again"
_SILENT = f"no command from the master for {_SILENT_FOR_NS * 1e-9:g} s, though its heartbeats come"
_TWO_WRITERS = "two writers in one session"
_NOBODYS = frozenset({"session", "sequence", SECOND_WRITER})


class Taken(NamedTuple):
    """Newest command since the last tick and its receive stamp, if any; whether any released the deadman."""

    command: tuple[MotionCommand, int] | None
    released: bool


_NOTHING = Taken(None, False)


class CommandSlot:
    """Keeps the newest command; one that was never taken is counted as superseded, but its release stays."""

    def __init__(self) -> None:
        self._taken = _NOTHING
        self.superseded = 0

    def put(self, command: MotionCommand, receive_ns: int) -> None:
        waiting = self._taken
        self.superseded += waiting.command is not None
        self._taken = Taken((command, receive_ns), waiting.released or not command.deadman)

    def take(self) -> Taken:
        taken, self._taken = self._taken, _NOTHING
        return taken


class CommandReceiver:
    """Passes the commands that the gate admits to a slot, from which the control loop takes them.

    Attributes:
        counters: refusals by rule.
        conflict: reason where two command in the session (nobody can say which is the master), or None.
    """

    def __init__(self, settings: SlaveAxisSettings, session: SlaveSession, events: AxisEvents) -> None:
        self.counters: Counter[str] = Counter()
        self.slot = CommandSlot()
        self._late_ns: tuple[int, int] | None = None
        self._received_ns: int | None = None
        self.conflict: str | None = None
        self._gate = CommandGate(_gate_limits(settings))
        self._session = session
        self._events = events

    def open(self, session_id: int) -> None:
        self._late_ns = self._received_ns = None
        self.conflict = None
        self._gate.open(session_id)

    def should_drop_session(self, now_ns: int, at_rest: bool) -> str | None:
        """Reason to release the session: a second writer; or, while the stage is at rest, over 3 s of nothing
        but late commands, or of no command, counted at first from the first call. Else None.
        """
        if self._received_ns is None:
            self._received_ns = now_ns
        late_ns = self._late_ns
        if self.conflict is not None:
            return self.conflict
        if at_rest and late_ns is not None and late_ns[1] - late_ns[0] > _LATE_FOR_NS:
            return _ONLY_LATE
        return _SILENT if at_rest and now_ns - self._received_ns > _SILENT_FOR_NS else None

    def on_command(self, command: MotionCommand, receive_ns: int) -> None:
        """Puts a command that the gate admits into the slot; counts and reports one that is refused. Ignores
        one of the present session, neither admitted nor refused, before the clocks are compared.
        """
        clock = self._session.offset
        if clock is None and command.session_id == self._session.holder:
            self._received_ns = receive_ns  # nothing is executed yet; a number of the future may not count
            return
        refusal = self._gate.admit(command, receive_ns, clock)
        if refusal is None or refusal.rule not in _NOBODYS:
            self._received_ns = receive_ns
        if refusal is None:
            self._late_ns = None
            self.slot.put(command, receive_ns)
        else:
            self._refuse(refusal, receive_ns)

    def _refuse(self, refusal: Refusal, receive_ns: int) -> None:
        """Counts the refusal and reports it as a limit event. A second writer sets `conflict`; a late command
        extends the span of late ones that `should_drop_session` judges.
        """
        if refusal.rule == "late":
            first_ns, _ = self._late_ns or (receive_ns, receive_ns)
            self._late_ns = first_ns, receive_ns
        if refusal.rule == SECOND_WRITER:
            self.conflict = _TWO_WRITERS
        self.counters[f"refused_{refusal.rule}"] += 1
        self._events.limit(LimitHit(refusal.rule, refusal.requested, refusal.limit, refusal.unit))


def _gate_limits(settings: SlaveAxisSettings) -> GateLimits:
    """Limits of age, position and velocity beyond which a command is refused; those of position and velocity
    are wider than the axis's own, which change a motion and refuse nothing.
    """
    low, high = settings.limits.workspace_m
    return GateLimits(
        max_age_ns=int(settings.gate.max_age_s * 1e9),
        position_m=(low - _RANGE_MARGIN_M, high + _RANGE_MARGIN_M),
        velocity_m_s=_RANGE_SPEEDS * settings.limits.max_velocity_m_s,
    )
