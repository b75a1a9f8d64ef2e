"""The port through which loops report safety events: event log, flight recorder and latch of a daemon."""

from collections.abc import Mapping

from forefeel.common.flight import Rings
from forefeel.common.messages import Handshake, SafetyState

SAFETY = "safety"
"""The event of a transition of the slave's safety state machine."""

HALTED = frozenset({SafetyState.FAULT, SafetyState.ESTOPPED})
UNASKED = frozenset({"watchdog", "session_lost", "misaligned", "round_trip"})
"""Events that end a motion without the person's wish."""

REFUSALS = frozenset((
    "session", "sequence", "late", "future", "range", "alignment", "round_trip", "slow_limit", "no_force",
    "zero",
))  # fmt: skip
"""Rules by which a command is refused; the others change a motion, and stand in the recording."""

Detail = str | int | float | bool | None | list[str] | dict[str, str]


class EventSink:
    """Port to event log, flight recorder and latch; no call blocks, any thread may call.

    This class keeps nothing, for simulations in virtual time; `forefeel.common.state` has the one that does.

    Attributes:
        rings: what the flight recorder holds in memory; None where there is none.
        latched: axes whose emergency stop, or fault of a motion, outlived the daemon before, with its reason.
        problem: why the latch can not be written, if it can not.
        lost: event lines that could not be written.
    """

    rings: Rings | None = None
    latched: Mapping[str, str] = {}

    @property
    def problem(self) -> str | None:
        return None

    @property
    def lost(self) -> int:
        return 0

    def note(self, event: str, now_ns: int, axis: str = "", /, **details: Detail) -> None:
        """Logs one event, with the wall clock of now."""

    def flight(self, axis: str, event: str, reason: str, now_ns: int) -> None:
        """Requests a flight record of the last 2 s and the next half second."""

    def is_persisted(self, axis: str, stopped: bool) -> bool:
        """True when a new start would find the axis latched, or not latched, as it is now. `stopped`: it is
        in an emergency stop.
        """
        del axis, stopped
        return True

    def thread_fault(self, axis: str, error: BaseException, now_ns: int) -> None:
        """Logs that a thread of the daemon has failed and requests a flight record, named after `axis`."""
        reason = f"{type(error).__name__}: {error}"[:200]
        self.note("thread_fault", now_ns, reason=reason)
        self.flight(axis, "thread_fault", reason, now_ns)


NULL_EVENT_SINK = EventSink()


def peer(handshake: Handshake) -> dict[str, Detail]:
    """Details of a handshake for the log: session; instance, software, settings, drivers of the peer."""
    return {
        "session": handshake.session_id,
        "peer": handshake.instance_id,
        "software": handshake.software,
        "settings": handshake.settings_hash,
        "drivers": dict(handshake.drivers),
    }
