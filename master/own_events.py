"""What the master's own side does: the limits of the rendered force, and how it stands with the slave."""

from collections import Counter
from collections.abc import Iterable
from typing import Literal

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.limit_coalescer import LimitCoalescer
from forefeel.common.limiter import LimitHit
from forefeel.common.messages import LimitEvent, MasterEvent

Standing = Literal["no_link", "linked", "handle_fault", "failed"]
_EVENTS: dict[Standing, str] = {
    "no_link": "session_lost",
    "linked": "session_opened",
    "handle_fault": "handle_fault",
    "failed": "fault",
}


class OwnEvents:
    """Publishes both as events, as the slave does with its own.

    Threads: `limited` runs in the haptic loop, the rest on asyncio.
    """

    def __init__(self, bus: Bus) -> None:
        self._limits = LimitCoalescer()
        self._limit = bus.publisher(topics.MASTER_LIMIT)
        self._event = bus.publisher(topics.MASTER_EVENT)
        self._standing: Standing = "no_link"

    def limited(self, hits: Iterable[LimitHit]) -> None:
        """The force was changed by these limits in this tick."""
        for hit in hits:
            self._limits.add(hit)

    def serve(
        self, now_ns: int, session_id: int, standing: Standing, reason: str, last: bool = False
    ) -> None:
        """Publishes what is due; `standing`: how the master stands now, and why."""
        before, self._standing = self._standing, standing
        if before != standing:
            header = self._event.header(session_id, now_ns)
            event = MasterEvent(
                **header, before=before, event=_EVENTS[standing], after=standing, reason=reason[:256]
            )
            self._event.send(event)
        for hit, count in self._limits.due(now_ns, last):
            header = self._limit.header(session_id, now_ns)
            self._limit.send(LimitEvent(**header, **hit._asdict(), count=count))

    def counts(self) -> Counter[str]:
        """How often a limit changed the force."""
        return Counter(force_limited=self._limits.total)
