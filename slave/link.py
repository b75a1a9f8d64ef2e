"""The slave's side of a session: answers handshakes, holds the lease, compares clocks."""

from collections import Counter
from collections.abc import Callable

from common import topics
from common.bus import Bus
from common.clock_offset import OffsetEstimate
from common.heartbeats import Heartbeats
from common.messages import Handshake, Heartbeat
from common.settings import differences, settings_hash, shared_text
from common.slots import BoundedQueue
from slave.diary import AxisDiary
from slave.session import Lease
from slave.settings import SlaveAxisSettings

_EXPIRED = "the lease expired"


class SlaveLink:
    """One axis' link to whoever is master.

    Threads: `_on_*` run where the transport delivers; `serve` and `beat` on asyncio; the rest on any.

    Attributes:
        counters: handshakes accepted and refused.
        lost_reason: why there is no session, if there is none.
    """

    def __init__(
        self, cell: str, settings: SlaveAxisSettings, bus: Bus, instance_id: int, diary: AxisDiary
    ) -> None:
        self.counters: Counter[str] = Counter()
        self.lost_reason = _EXPIRED
        self._shared = shared_text(cell, settings.name, settings.limits)
        self._instance_id = instance_id
        self._diary = diary
        self._lease = Lease(int(settings.gate.lease_s * 1e9))
        self._handshakes: BoundedQueue[tuple[Handshake, int]] = BoundedQueue(16)
        self._heartbeats = Heartbeats(bus.outlet(topics.SLAVE_HEARTBEAT))
        self._answer = bus.outlet(topics.SLAVE_HANDSHAKE)
        bus.subscribe(topics.MASTER_HANDSHAKE, self._on_handshake)
        bus.subscribe(topics.MASTER_HEARTBEAT, self._on_heartbeat)

    @property
    def holder(self) -> int:
        """Session id of the newest holder of the lease, 0 before any."""
        return self._lease.holder

    @property
    def offset(self) -> OffsetEstimate | None:
        """The master's clock minus ours."""
        return self._heartbeats.offset

    def live(self, now_ns: int) -> bool:
        """Whether somebody holds the lease now."""
        return self._lease.live(now_ns)

    def _on_handshake(self, handshake: Handshake, receive_ns: int) -> None:
        self._handshakes.put((handshake, receive_ns))

    def _on_heartbeat(self, heartbeat: Heartbeat, receive_ns: int) -> None:
        if heartbeat.session_id != self._lease.holder or not self._lease.live(receive_ns):
            self.counters["heartbeats_of_another_session"] += 1
        elif self._heartbeats.heard(heartbeat, receive_ns):
            self._lease.renew(heartbeat.session_id, receive_ns)
        else:
            self.counters["heartbeats_refused"] += 1

    def serve(self, now_ns: int, at_rest: bool, opened: Callable[[int], None]) -> None:
        """Answers what came in; `opened` is called with the id of each new session."""
        for handshake, receive_ns in self._handshakes.drain():
            before = self._lease.holder
            reason = self._open(handshake, receive_ns, at_rest, opened)
            self._diary.answered(now_ns, handshake, reason, before)
            self.counters["handshakes_refused" if reason else "handshakes_accepted"] += 1
            self._answer.send(
                Handshake(
                    **self._answer.header(handshake.session_id, now_ns),
                    role="slave",
                    instance_id=self._instance_id,
                    software="forefeel",
                    settings_hash=settings_hash(self._shared),
                    settings=self._shared,
                    accepted=not reason,
                    reason=reason,
                )
            )

    def let_go(self, now_ns: int, reason: str) -> None:
        """Ends the session, so that the master asks for a new one."""
        if self._lease.live(now_ns):
            self.lost_reason = reason
            self._lease.let_go(now_ns)
            self.counters["sessions_let_go"] += 1

    def beat(self, now_ns: int) -> None:
        """A heartbeat to the holder of the lease."""
        if self._lease.live(now_ns):
            self._heartbeats.beat(self._lease.holder, now_ns)

    def _open(
        self, handshake: Handshake, receive_ns: int, at_rest: bool, opened: Callable[[int], None]
    ) -> str:
        """Why the handshake is refused; empty when its session holds the lease."""
        if handshake.role != "master":
            return "only a master may open a session"
        if handshake.settings_hash != settings_hash(self._shared):
            return f"settings differ: {differences(self._shared, handshake.settings)}"
        known = handshake.session_id == self._lease.holder
        reason = self._lease.request(handshake.session_id, receive_ns, at_rest)
        if reason is None and not known:
            self.lost_reason = _EXPIRED
            self._heartbeats.restart()
            opened(handshake.session_id)
        return reason or ""
