"""The master's side of a session: asks until it is accepted, notices when it is lost, then asks with a new
id. Pure.
"""

from collections.abc import Callable
from enum import Enum

from forefeel.common.events.text import span
from forefeel.common.settings import LONGEST_ROUND_TRIP_S
from forefeel.common.topics import SLAVE_STATE

_LOST_AFTER_NS = 1_000_000_000
"""Without a state of the slave that names our session, which comes 50 times a second; the slave's own lease
lasts as long by default."""
_RETRY_NS = 250_000_000  # ns between two handshakes until an answer
_SILENT_AFTER_S = SLAVE_STATE.stale_after_s or 0.5
"""After so long without anything from the slave, its last word is no cause any more."""


class SessionState(Enum):
    ASKING = "asking for a session"
    OPEN = "session open"
    MISMATCH = "settings differ"


class Session:
    """One session after the other with one slave axis.

    Attributes:
        session_id: id in use.
        state: what is known of it.
        heard_ns: when the slave was heard last, None before.
        obstacle: what keeps the slave from being heard, as somebody found out who looked at the network;
            empty where it is not known.
    """

    def __init__(self, new_id: Callable[[], int]) -> None:
        self._new_id = new_id
        self.session_id = new_id()
        self.state = SessionState.ASKING
        self.heard_ns: int | None = None
        self.obstacle = ""
        self._reason = ""
        self._mine_ns = 0
        self._named = 0
        self._asked_ns: int | None = None
        self._asking_since_ns: int | None = None

    def should_ask(self, now_ns: int) -> bool:
        """True, noting the time, when a handshake is due: every 250 ms unless the session is open. Before
        that ends a session that no state of the slave has named for 1 s, and takes a new id.
        """
        if self.state is SessionState.OPEN and now_ns - self._mine_ns > _LOST_AFTER_NS:
            ended = {0: "the slave has ended the session", self.session_id: ""}
            self._start_again(ended.get(self._named, "the slave serves another master"))
        if self.state is SessionState.OPEN or (
            self._asked_ns is not None and now_ns - self._asked_ns < _RETRY_NS
        ):
            return False
        self._asked_ns = now_ns
        if self._asking_since_ns is None:
            self._asking_since_ns = now_ns
        return True

    def answered(
        self, session_id: int, accepted: bool, reason: str, asked_ns: int | None, now_ns: int
    ) -> None:
        """Takes the slave's answer to the handshake sent at `asked_ns`: opens the session, or notes the
        reason. Differing settings end the asking (MISMATCH). Where the id was used before, or the answer took
        too long, it takes a new id, so that no later answer to the old one opens a session.

        An answer to another id, without `asked_ns` or while not asking only counts as hearing the slave.
        """
        self.heard_ns, self.obstacle = now_ns, ""
        if session_id != self.session_id or self.state is not SessionState.ASKING or asked_ns is None:
            return
        took_s = (now_ns - asked_ns) * 1e-9
        if took_s > LONGEST_ROUND_TRIP_S:
            self._start_again(f"no answer within {LONGEST_ROUND_TRIP_S:g} s: it takes {took_s:.1f} s")
        elif accepted:
            self.state, self._mine_ns = SessionState.OPEN, now_ns
            self._reason = f"the slave accepted the session within {took_s * 1e3:.0f} ms"
        elif reason.startswith("settings differ"):
            self.state, self._reason = SessionState.MISMATCH, reason
        elif "used before" in reason:
            self._start_again(f"the slave refuses: {reason}")
        else:
            self._reason = f"the slave refuses: {reason}"

    def heard_state(self, session_id: int, now_ns: int) -> None:
        """Notes a state of the slave, which names the holder of the lease."""
        self.heard_ns, self.obstacle, self._named = now_ns, "", session_id
        if session_id == self.session_id:
            self._mine_ns = now_ns

    def is_heard(self, now_ns: int) -> bool:
        """True if the slave was heard within the last 0.5 s."""
        return self.heard_ns is not None and now_ns - self.heard_ns <= _SILENT_AFTER_S * 1e9

    def cause(self, now_ns: int) -> str:
        """Reason in one line why the session is open, or is not: the slave's answer while the slave is heard,
        else `obstacle`, else for how long it has been silent. Of a mismatch always the settings that differ.
        """
        if self.state is SessionState.MISMATCH:
            return self._reason
        since_ns = now_ns if self._asking_since_ns is None else self._asking_since_ns
        if self.is_heard(now_ns):
            return self._reason or f"no answer to the handshake for {span((now_ns - since_ns) * 1e-9)}"
        if self.obstacle:
            return self.obstacle
        if self.heard_ns is None:
            return f"no answer from the slave for {span((now_ns - since_ns) * 1e-9)}"
        return f"no state from the slave for {span((now_ns - self.heard_ns) * 1e-9)}"

    def _start_again(self, reason: str) -> None:
        self.session_id, self.state, self._reason = self._new_id(), SessionState.ASKING, reason
        self._asking_since_ns = None
