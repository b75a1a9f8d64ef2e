"""The lease: one writer at a time, handed over only while the stage is at rest. Pure."""


class Lease:
    """Who may command. A session lives while its heartbeats come; its id is never accepted twice.

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
        """How long the holder has been silent when its lease expires."""
        return (self._lease_ns if self.renewed else self._first_ns) * 1e-9

    def live(self, now_ns: int) -> bool:
        """Whether somebody holds the lease now."""
        return self.holder != 0 and now_ns < self._expires_ns

    def request(self, session_id: int, now_ns: int, at_rest: bool) -> str | None:
        """Why the session is refused, or None when it holds the lease from now on (a repeated request is
        harmless).
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
        """A heartbeat; True when it came from the holder of a live lease."""
        if session_id != self.holder or not self.live(now_ns):
            return False
        self._expires_ns, self.renewed = now_ns + self._lease_ns, True
        return True
