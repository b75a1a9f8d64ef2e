"""The lease: one writer at a time, handed over only while the stage is at rest. Pure."""


class Lease:
    """Who may command. A session lives while its heartbeats come; its id is never accepted twice.

    Attributes:
        holder: session id of the writer, or of the last one when its lease has expired; 0 before the first.
    """

    def __init__(self, lease_ns: int) -> None:
        self._lease_ns = lease_ns
        self._expires_ns = 0
        self._used: set[int] = set()
        self.holder = 0

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
        self.holder = session_id
        self._expires_ns = now_ns + self._lease_ns
        return None

    def let_go(self, now_ns: int) -> None:
        """Ends the lease before its time: whoever held it asks anew, with a new id."""
        self._expires_ns = min(self._expires_ns, now_ns)

    def renew(self, session_id: int, now_ns: int) -> bool:
        """A heartbeat; True when it came from the holder of a live lease."""
        if session_id != self.holder or not self.live(now_ns):
            return False
        self._expires_ns = now_ns + self._lease_ns
        return True
