"""Heartbeats of one session: each keeps the lease and carries the four stamps that compare the clocks."""

from forefeel.common.bus import Publisher
from forefeel.common.clock_offset import ClockOffset, OffsetEstimate
from forefeel.common.messages import Heartbeat
from forefeel.common.stamp_order import StampOrder

_REMEMBERED = 256  # beats: 13 s of them, more than any round trip that a session outlives


class Heartbeats:
    """Sends and takes the heartbeats of one end, and estimates the peer's clock from them. `receive` runs
    where the transport delivers, `beat` on asyncio.
    """

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self.restart()

    def restart(self) -> None:
        """Forgets the peer for a new session. A new estimator, for the old one may be in use."""
        self._clock = ClockOffset()
        self._newest: tuple[int, int] | None = None
        self._order = StampOrder()
        self._answered = False
        self._sent_ns: tuple[int, ...] = ()

    @property
    def offset(self) -> OffsetEstimate | None:
        return self._clock.best

    def receive(self, heartbeat: Heartbeat, receive_ns: int) -> bool:
        """Takes a heartbeat of the peer, received at `receive_ns` of our clock; False where it is refused.
        `beat` echoes it next, and its own echo updates `offset`.

        Refused as replay or forgery: one not newer, or stamped ahead of the others; one whose echo was not
        sent lately, or is missing once one has come. So a peer whose clock is set back loses its session.
        """
        echo_ns, echo_receive_ns = heartbeat.echo_stamp_ns, heartbeat.echo_receive_ns
        known = not self._answered if echo_ns is None else echo_ns in self._sent_ns
        if not known or self._order.judge(heartbeat.stamp_ns, receive_ns) != "newer":
            return False
        self._newest = heartbeat.stamp_ns, receive_ns
        if echo_ns is not None and echo_receive_ns is not None:
            self._answered = True
            self._clock.update(echo_ns, echo_receive_ns, heartbeat.stamp_ns, receive_ns)
        return True

    def beat(self, session_id: int, now_ns: int) -> None:
        """Sends a heartbeat that echoes the peer's newest one: its stamp and when it was received, both None
        before any. Remembers `now_ns` as a stamp that the peer may echo.
        """
        stamp_ns, receive_ns = self._newest or (None, None)
        self._sent_ns = (*self._sent_ns[1 - _REMEMBERED :], now_ns)
        self._publisher.send(
            Heartbeat(
                **self._publisher.header(session_id, now_ns),
                echo_stamp_ns=stamp_ns,
                echo_receive_ns=receive_ns,
            )
        )
