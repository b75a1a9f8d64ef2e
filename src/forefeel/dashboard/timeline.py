"""The time of the charts: seconds on the master's clock. Pure."""

from forefeel.common.clock_offset import DRIFT_DIVISOR
from forefeel.common.stamp_order import StampOrder

RESTART_NS = 10_000_000_000
"""A clock that is further off than this was started anew."""


class Timeline:
    """Converts stamps of the master and times of the listener to the seconds of the charts.

    The smallest transit (receive - stamp) stands for the difference of the two clocks. Until a master is
    heard the listener's own clock stands in for its.

    Attributes:
        epoch: grows whenever the time begins anew: the master's host was started again.
    """

    def __init__(self) -> None:
        self.epoch = 0
        self._origin_ns: int | None = None
        self._transit_ns: int | None = None
        self._seen_ns = 0
        self._order = StampOrder(backwards=True)

    def add_stamp(self, stamp_ns: int, receive_ns: int) -> bool | None:
        """Updates the clocks' difference. True: time begins anew with the stamp, and `epoch` grows; False: it
        goes on; None: the stamp is out of order and not used.
        """
        if self._order.judge(stamp_ns, receive_ns) != "newer":
            return None
        transit_ns, base_ns = receive_ns - stamp_ns, self._base_ns(receive_ns)
        anew = base_ns is None or abs(transit_ns - base_ns) > RESTART_NS
        if base_ns is None or anew or transit_ns <= base_ns:
            self._transit_ns, self._seen_ns = transit_ns, receive_ns
        if anew:
            self._origin_ns = stamp_ns
            self.epoch += 1
        return anew

    def stamp_s(self, stamp_ns: int) -> float:
        return (stamp_ns - (self._origin_ns or 0)) * 1e-9

    def now_s(self, now_ns: int) -> float:
        """The listener's time on the charts; before any stamp the first call is 0."""
        if self._origin_ns is None:
            self._origin_ns = now_ns
        return (now_ns - (self._base_ns(now_ns) or 0) - self._origin_ns) * 1e-9

    def _base_ns(self, receive_ns: int) -> int | None:
        if self._transit_ns is None:
            return None
        return self._transit_ns + max(0, receive_ns - self._seen_ns) // DRIFT_DIVISOR
