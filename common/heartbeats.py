"""Heartbeats of one session: each keeps the lease and carries the four stamps that compare the clocks."""

from common.bus import Outlet
from common.clock_offset import ClockOffset, OffsetEstimate
from common.messages import Heartbeat


class Heartbeats:
    """One end of the exchange. `heard` runs where the transport delivers, `beat` on asyncio."""

    def __init__(self, outlet: Outlet) -> None:
        self._outlet = outlet
        self.restart()

    def restart(self) -> None:
        """A new session: nothing is known of the peer. A new estimator, for the old one may be in use."""
        self._clock = ClockOffset()
        self._newest: tuple[int, int] | None = None

    @property
    def offset(self) -> OffsetEstimate | None:
        """The peer's clock minus ours, None before the first exchange."""
        return self._clock.best

    def heard(self, heartbeat: Heartbeat, receive_ns: int) -> None:
        """A heartbeat of the peer, received at `receive_ns` of our clock."""
        self._newest = heartbeat.stamp_ns, receive_ns
        if heartbeat.echo_stamp_ns is not None and heartbeat.echo_receive_ns is not None:
            self._clock.update(
                heartbeat.echo_stamp_ns, heartbeat.echo_receive_ns, heartbeat.stamp_ns, receive_ns
            )

    def beat(self, session_id: int, now_ns: int) -> None:
        """Sends one, echoing the peer's newest."""
        stamp_ns, receive_ns = self._newest or (None, None)
        self._outlet.send(
            Heartbeat(
                **self._outlet.header(session_id, now_ns), echo_stamp_ns=stamp_ns, echo_receive_ns=receive_ns
            )
        )
