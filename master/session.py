"""The master's side of a session: asks until it is accepted, notices when it is lost, then asks with a new
id. Pure.
"""

from collections.abc import Callable
from enum import Enum

_LOST_AFTER_NS = 1_000_000_000
_RETRY_NS = 250_000_000


class Link(Enum):
    """What the master knows of its session."""

    ASKING = "asking for a session"
    OPEN = "session open"
    MISMATCH = "settings differ"


class Session:
    """One session after the other with one slave axis.

    Attributes:
        session_id: id in use.
        link: its state.
        reason: the slave's last word.
        heard_ns: when the slave was heard last, None before.
    """

    def __init__(self, new_id: Callable[[], int]) -> None:
        self._new_id = new_id
        self.session_id = new_id()
        self.link = Link.ASKING
        self.reason = "no answer yet"
        self.heard_ns: int | None = None
        self._mine_ns = 0
        self._asked_ns: int | None = None

    def should_ask(self, now_ns: int) -> bool:
        """Whether a handshake is to be sent now."""
        if self.link is Link.OPEN and now_ns - self._mine_ns > _LOST_AFTER_NS:
            self._start_again("the slave no longer holds our session")
        if self.link is Link.OPEN or (self._asked_ns is not None and now_ns - self._asked_ns < _RETRY_NS):
            return False
        self._asked_ns = now_ns
        return True

    def answered(self, session_id: int, accepted: bool, reason: str, now_ns: int) -> None:
        """The slave's answer to a handshake; one for an older session is ignored."""
        self.heard_ns = now_ns
        if session_id != self.session_id or self.link is Link.OPEN:
            return
        self.reason = reason or "accepted"
        if accepted:
            self.link, self._mine_ns = Link.OPEN, now_ns
        elif reason.startswith("settings differ"):
            self.link = Link.MISMATCH
        elif "used before" in reason:
            self._start_again(reason)

    def heard_state(self, session_id: int, now_ns: int) -> None:
        """A state of the slave that names the holder of the lease."""
        self.heard_ns = now_ns
        if session_id == self.session_id:
            self._mine_ns = now_ns

    def _start_again(self, reason: str) -> None:
        self.session_id, self.link, self.reason = self._new_id(), Link.ASKING, reason
