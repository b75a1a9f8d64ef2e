"""The slave's side of a session: answers handshakes, holds the lease, compares clocks.

The lease knows one writer at a time, and is handed over only while the stage is at rest.
"""

from collections import Counter
from collections.abc import Callable

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock_offset import MAX_RATE_PPM, OffsetEstimate
from forefeel.common.daemon import software_version
from forefeel.common.events.text import span
from forefeel.common.heartbeats import Heartbeats
from forefeel.common.messages import Handshake, Heartbeat
from forefeel.common.settings import LONGEST_ROUND_TRIP_S, differences, settings_hash, shared_text
from forefeel.common.slots import BoundedQueue
from forefeel.slave.devices import Devices
from forefeel.slave.events import SlaveEvents
from forefeel.slave.settings import SlaveAxisSettings


class Lease:
    """The right to command. A session lives while its heartbeats come; its id is never accepted twice.

    Args:
        lease_ns: how long it lives after a heartbeat.
        round_trip_ns: how much longer after it was accepted. The first heartbeat follows the acceptance, so
            that it comes a round trip later.

    Attributes:
        holder: session id of the writer, or of the last one when its lease has expired; 0 before the first.
        renewed: whether the holder sent a heartbeat.
    """

    def __init__(self, lease_ns: int, round_trip_ns: int = 0) -> None:
        self._lease_ns = lease_ns
        self._first_ns = lease_ns + round_trip_ns
        self._expires_ns = 0
        self._used: set[int] = set()
        self.holder = 0
        self.renewed = False

    @property
    def expired_after_s(self) -> float:
        """Silence of the holder in s after which its lease expires."""
        return (self._lease_ns if self.renewed else self._first_ns) * 1e-9

    def live(self, now_ns: int) -> bool:
        return self.holder != 0 and now_ns < self._expires_ns

    def request(self, session_id: int, now_ns: int, at_rest: bool) -> str | None:
        """Grants the lease to a session for its first term: None; also, without a new term, where it holds it
        already. Else the reason of the refusal: an id of 0 or used before, its own after the lease ended too,
        another session that is live, a stage not `at_rest`.
        """
        if session_id == self.holder and self.live(now_ns):
            return None
        if session_id in self._used or session_id == 0:
            return "this session id was used before"
        if self.live(now_ns):
            return "another session holds the lease"
        if not at_rest:
            return "the stage is not at rest"
        self._used.add(session_id)
        self.holder, self.renewed = session_id, False
        self._expires_ns = now_ns + self._first_ns
        return None

    def release(self, now_ns: int) -> None:
        """Ends the lease before its time: whoever held it asks anew, with a new id."""
        self._expires_ns = min(self._expires_ns, now_ns)

    def renew(self, session_id: int, now_ns: int) -> bool:
        """Extends a live lease by a heartbeat of its holder; False for any other."""
        if session_id != self.holder or not self.live(now_ns):
            return False
        self._expires_ns, self.renewed = now_ns + self._lease_ns, True
        return True


class SlaveSession:
    """One axis' link to whoever is master.

    Threads: `_on_*` run where the transport delivers; `serve` and `beat` on asyncio; the rest on any.

    Attributes:
        counters: handshakes accepted and refused.
    """

    def __init__(
        self,
        cell: str,
        settings: SlaveAxisSettings,
        devices: Devices,
        bus: Bus,
        instance_id: int,
        events: SlaveEvents,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._ended = ""
        self._awaited = False
        self._shared = shared_text(cell, settings.name, settings.limits)
        self._instance_id, self._devices = instance_id, devices
        self._events = events
        self._lease = Lease(int(settings.gate.lease_s * 1e9), int(LONGEST_ROUND_TRIP_S * 1e9))
        self._handshakes: BoundedQueue[tuple[Handshake, int]] = BoundedQueue(16)
        self._heartbeats = Heartbeats(bus.publisher(topics.SLAVE_HEARTBEAT))
        self._answer = bus.publisher(topics.SLAVE_HANDSHAKE)
        bus.subscribe(topics.MASTER_HANDSHAKE, self._on_handshake)
        bus.subscribe(topics.MASTER_HEARTBEAT, self._on_heartbeat)

    @property
    def holder(self) -> int:
        """Session id of the newest holder of the lease, 0 before any."""
        return self._lease.holder

    @property
    def offset(self) -> OffsetEstimate | None:
        return self._heartbeats.offset

    @property
    def lost_reason(self) -> str:
        """Reason for the end of the last session; meant for when there is none."""
        return self._ended or f"no heartbeat from the master for {span(self._lease.expired_after_s)}"

    def clock_fault(self, now_ns: int) -> str | None:
        """Fault text when the master holds the lease with a clock too fast or slow to follow; else None."""
        clock = self._heartbeats.offset
        if clock is None or abs(clock.rate_ppm) <= MAX_RATE_PPM or not self._lease.live(now_ns):
            return None
        way = "fast" if clock.rate_ppm > 0.0 else "slow"
        return (
            f"the master's clock runs at least {abs(clock.rate_ppm):.0f} ppm {way} against ours, "
            f"limit {MAX_RATE_PPM:.0f} ppm: check the time synchronisation of both hosts"
        )

    def live(self, now_ns: int) -> bool:
        return self._lease.live(now_ns)

    def _on_handshake(self, handshake: Handshake, receive_ns: int) -> None:
        self._handshakes.put((handshake, receive_ns))

    def _on_heartbeat(self, heartbeat: Heartbeat, receive_ns: int) -> None:
        """Renews the lease by a heartbeat of its live holder; only counts a replay, or another session's."""
        if heartbeat.session_id != self._lease.holder or not self._lease.live(receive_ns):
            self.counters["heartbeats_of_another_session"] += 1
        elif self._heartbeats.receive(heartbeat, receive_ns):
            self._lease.renew(heartbeat.session_id, receive_ns)
        else:
            self.counters["heartbeats_refused"] += 1

    def serve(self, now_ns: int, at_rest: bool, opened: Callable[[int], None]) -> None:
        """Answers each handshake that came in, accepted or refused with a reason; counts and logs it. Calls
        `opened` with the id of each session that is opened anew.
        """
        for handshake, receive_ns in self._handshakes.drain():
            before = self._lease.holder
            reason = self._open(handshake, receive_ns, at_rest, opened)
            self._events.session_answered(handshake, handshake.session_id != before, reason or None, now_ns)
            self.counters["handshakes_refused" if reason else "handshakes_accepted"] += 1
            self._answer.send(
                Handshake(
                    **self._answer.header(handshake.session_id, now_ns),
                    role="slave",
                    instance_id=self._instance_id,
                    software=f"forefeel {software_version()}",
                    settings_hash=settings_hash(self._shared),
                    settings=self._shared,
                    accepted=not reason,
                    reason=reason,
                    answers_stamp_ns=handshake.stamp_ns,
                    full_scale_n=self._devices.load_cell.full_scale_n,
                    drivers=dict(self._devices.drivers),
                )
            )

    def ended_unrenewed(self, now_ns: int) -> str:
        """Reason, given once, for the end of a session without any heartbeat: no transition tells of it."""
        if not self._awaited or self._lease.live(now_ns):
            return ""
        self._awaited = False
        return "" if self._lease.renewed else self.lost_reason

    def release(self, now_ns: int, reason: str) -> None:
        if self._lease.live(now_ns):
            self._ended = reason
            self._lease.release(now_ns)
            self.counters["sessions_released"] += 1

    def beat(self, now_ns: int) -> None:
        if self._lease.live(now_ns):
            self._heartbeats.beat(self._lease.holder, now_ns)

    def _open(
        self, handshake: Handshake, receive_ns: int, at_rest: bool, opened: Callable[[int], None]
    ) -> str:
        """Opens a session where the peer is a master with equal settings and the lease is granted; returns
        the reason of a refusal, else empty. A new session restarts the heartbeats and calls `opened` with its
        id; a handshake that its holder repeats changes nothing.
        """
        if handshake.role != "master":
            return "only a master may open a session"
        if handshake.settings_hash != settings_hash(self._shared):
            return f"settings differ: {differences(self._shared, handshake.settings)}"
        known = handshake.session_id == self._lease.holder
        reason = self._lease.request(handshake.session_id, receive_ns, at_rest)
        if reason is None and not known:
            self._ended, self._awaited = "", True
            self._heartbeats.restart()
            opened(handshake.session_id)
        return reason or ""
