"""An emergency stop that the person asked for: sent again and again until the slave shows it. Pure."""

from forefeel.common.messages import SlaveState
from forefeel.common.settings import LONGEST_ROUND_TRIP_S

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
        self.reason = ""
        self._asked_ns = self._acknowledged_ns = self._sent_ns = 0

    @property
    def wanted(self) -> bool:
        return self._asked_ns != self._acknowledged_ns

    def ask(self, reason: str, now_ns: int) -> bool:
        """Requests the stop; False where it is wanted already: the first reason stands, and only a state that
        acknowledges this request, too, ends it.
        """
        anew = not self.wanted
        if anew:
            self.reason, self._sent_ns = reason, now_ns - _SELDOM_NS
        self._asked_ns = now_ns
        return anew

    def due(self, now_ns: int, state: SlaveState | None, received_ns: int, outward_ns: int | None) -> bool:
        """True, noting the time, when a wanted stop is due: every 20 ms for 2 s, then every 250 ms. A `state`
        that acknowledges a stop ends the request, if the slave made it when the stop can have arrived: one of
        before may show a stop that somebody has cleared meanwhile.

        `outward_ns`: smallest transit to the slave, its stamp minus ours. None where the clocks are not
        compared; then a state counts that is received over the longest round trip after the request.
        """
        if not self.wanted:
            return False
        asked_ns = self._asked_ns  # read once: another thread may ask anew meanwhile
        if state is not None and state.acknowledges_stop:
            if outward_ns is None:
                later = received_ns - asked_ns > LONGEST_ROUND_TRIP_S * 1e9
            else:
                later = state.stamp_ns - outward_ns > asked_ns
            if later:
                self._acknowledged_ns = asked_ns
                return False
        often = now_ns - asked_ns <= _OFTEN_FOR_NS
        if now_ns - self._sent_ns < (_OFTEN_NS if often else _SELDOM_NS):
            return False
        self._sent_ns = now_ns
        return True
