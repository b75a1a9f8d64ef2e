"""An emergency stop that the person asked for: sent again and again until the slave shows it. Pure."""

from forefeel.common.messages import SlaveState

_OFTEN_NS = 20_000_000  # ns between two repetitions at first
_OFTEN_FOR_NS = 2_000_000_000  # ns for which it is repeated that often
_SELDOM_NS = 250_000_000  # ns between two repetitions after that


class StopRequest:
    """Says when to send a requested emergency stop: every 20 ms for 2 s, then every 250 ms, until the slave
    acknowledges it, for a link that comes back must not have lost it.

    Attributes:
        wanted: requested and not acknowledged yet; the deadman counts as released meanwhile.
    """

    def __init__(self) -> None:
        self.wanted = False
        self.reason = ""
        self._asked_ns = 0
        self._sent_ns = 0

    def ask(self, reason: str, now_ns: int) -> bool:
        """Requests the stop; False where it is wanted already: the first reason stands."""
        if self.wanted:
            return False
        self.reason, self._asked_ns, self._sent_ns = reason, now_ns, now_ns - _SELDOM_NS
        self.wanted = True
        return True

    def due(self, now_ns: int, state: SlaveState | None, received_ns: int) -> bool:
        """True, noting the time, when a wanted stop is due: every 20 ms for 2 s, then every 250 ms. A `state`
        that was received after the request and acknowledges a stop ends the request.
        """
        if not self.wanted:
            return False
        if state is not None and state.acknowledges_stop and received_ns > self._asked_ns:
            self.wanted = False
            return False
        often = now_ns - self._asked_ns <= _OFTEN_FOR_NS
        if now_ns - self._sent_ns < (_OFTEN_NS if often else _SELDOM_NS):
            return False
        self._sent_ns = now_ns
        return True
