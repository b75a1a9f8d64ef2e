"""What one direction of an emulated cable does to packets, and when each is due. Pure.

The statistics are those of `forefeel.common.transport.impairment`, here for IP packets instead of messages:
whatever runs above (TCP, TLS, QUIC, UDP) retransmits, acknowledges and reorders by itself.
"""

import heapq
from collections import Counter
from itertools import count

from forefeel.common.transport.impairment import Impairment
from forefeel.common.transport.settings import ImpairmentSettings

S = 1_000_000_000
_CONNECTION = slice(12, 24)
"""Both addresses and both ports in an IPv4 packet without options."""


class Way:
    """One direction: packets are offered and taken when they are due.

    Attributes:
        counts: packets `offered`, `lost`, `delivered`, `doubled`, `cut`, `too_large`, `forgotten`.
    """

    def __init__(self, seed: int) -> None:
        self.counts: Counter[str] = Counter()
        self._seed = seed
        self._order = count()
        self._under_way: list[tuple[int, int, bytes]] = []
        self._impairment: Impairment | None = None
        self._largest_bytes: int | None = None
        self._known: set[bytes] = set()
        self._forgotten: frozenset[bytes] = frozenset()
        self._floor_ns = self._stalled_until_ns = 0
        self._cut = False

    def shape(self, settings: ImpairmentSettings, largest_bytes: int | None = None) -> None:
        """From now on; what is under way keeps its time, and is not overtaken by what comes.

        A packet of more than `largest_bytes` is dropped without a word, as by a path whose MTU nobody says.
        """
        self._seed += 1
        self._impairment = None if settings.transparent else Impairment(settings, self._seed)
        self._largest_bytes = largest_bytes
        self._floor_ns = max((due_ns for due_ns, _, _ in self._under_way), default=0)

    def stall(self, now_ns: int, stall_s: float) -> None:
        """Holds everything, also what is under way, and delivers it in one burst at the end."""
        self._stalled_until_ns = now_ns + round(stall_s * S)

    def cut(self) -> None:
        self._cut = True
        self.counts["cut"] += len(self._under_way)
        self._under_way.clear()

    def mend(self) -> None:
        self._cut = False

    def forget(self) -> None:
        """No packet passes any more of a TCP connection that has been seen, as behind a firewall that was
        started anew: neither end hears that the other one has gone.
        """
        self._forgotten = frozenset(self._known)

    def offer(self, packet: bytes, now_ns: int) -> None:
        self.counts["offered"] += 1
        refusal = self._refusal(packet)
        if refusal is not None:
            self.counts[refusal] += 1
            return
        delays_ns = (0,) if self._impairment is None else self._impairment.plan(now_ns)
        self.counts["lost"] += not delays_ns
        self.counts["doubled"] += len(delays_ns) > 1
        for delay_ns in delays_ns:
            due_ns = max(now_ns + delay_ns, self._floor_ns)
            heapq.heappush(self._under_way, (due_ns, next(self._order), packet))

    def take(self, now_ns: int) -> list[tuple[int, bytes]]:
        """What is due by now, in order: (when it was due, packet)."""
        if now_ns < self._stalled_until_ns:
            return []
        taken: list[tuple[int, bytes]] = []
        while self._under_way and self._under_way[0][0] <= now_ns:
            due_ns, _, packet = heapq.heappop(self._under_way)
            taken.append((max(due_ns, self._stalled_until_ns), packet))
        self.counts["delivered"] += len(taken)
        return taken

    @property
    def next_ns(self) -> int | None:
        """When something is due next; None when nothing is under way."""
        return max(self._under_way[0][0], self._stalled_until_ns) if self._under_way else None

    def _refusal(self, packet: bytes) -> str | None:
        """Why the packet does not pass whatever the chances, as it is counted."""
        connection = packet[_CONNECTION]
        self._known.add(connection)
        if self._cut:
            return "cut"
        if self._largest_bytes is not None and len(packet) > self._largest_bytes:
            return "too_large"
        return "forgotten" if connection in self._forgotten else None
