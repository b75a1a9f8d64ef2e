"""A cable in software: `python -m tests.system.net.forwarder TUN_A TUN_B SEED`.

IP packets go from one TUN device, an open descriptor, to the other through a `Way`. Each line on the standard
input is a JSON order, answered by a JSON line with the CLOCK_MONOTONIC stamp at which it took effect:
`{"do": "shape" | "stall" | "cut" | "mend" | "forget" | "count", ...}`. It ends with the standard input.
"""

import heapq
import json
import os
import select
import sys
import time
from collections import Counter
from itertools import count
from typing import Any

from forefeel.common.config import checked
from forefeel.common.runtime.realtime import prepare_thread
from forefeel.common.transport.impairment import Impairment
from forefeel.common.transport.settings import ImpairmentSettings

S = 1_000_000_000
_CONNECTION = slice(12, 24)
"""Both addresses and both ports in an IPv4 packet without options."""
_MTU = 65_535
_MOST_AT_ONCE = 64
_PRIORITY = 70  # a cable waits for no program of this machine
_IDLE_S = 1.0
_GRAIN_S = 0.0005
"""Of its rounds: packets that come together go together, or the cable takes a quarter of a processor."""


class Way:
    """One direction: packets are offered and taken when they are due.

    The statistics are those of `forefeel.common.transport.impairment`, here for IP packets instead of
    messages: whatever runs above (TCP, TLS, QUIC, UDP) retransmits, acknowledges and reorders by itself.

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
        connection = packet[_CONNECTION]
        self._known.add(connection)
        for refusal, applies in (
            ("cut", self._cut),
            ("too_large", self._largest_bytes is not None and len(packet) > self._largest_bytes),
            ("forgotten", connection in self._forgotten),
        ):
            if applies:
                self.counts[refusal] += 1
                return
        delays_ns = (0,) if self._impairment is None else self._impairment.plan(now_ns)
        self.counts["lost"] += not delays_ns
        self.counts["doubled"] += len(delays_ns) > 1
        for delay_ns in delays_ns:
            due_ns = max(now_ns + delay_ns, self._floor_ns)
            heapq.heappush(self._under_way, (due_ns, next(self._order), packet))

    def take(self, now_ns: int) -> list[bytes]:
        """The packets that are due by now, in order."""
        taken: list[bytes] = []
        while self.next_ns is not None and self.next_ns <= now_ns:
            taken.append(heapq.heappop(self._under_way)[2])
        self.counts["delivered"] += len(taken)
        return taken

    @property
    def next_ns(self) -> int | None:
        """When something is due next; None when nothing is under way."""
        return max(self._under_way[0][0], self._stalled_until_ns) if self._under_way else None


class Forwarder:
    """Both ways of the cable."""

    def __init__(self, ends: tuple[int, int], seed: int) -> None:
        a, b = ends
        self._ways = {"ab": Way(1000 * seed), "ba": Way(1000 * seed + 500)}
        self._routes = ((a, self._ways["ab"], b), (b, self._ways["ba"], a))
        self._orders = b""

    def run(self) -> None:
        """Forwards until its standard input ends."""
        while True:
            due_ns = [way.next_ns for way in self._ways.values() if way.next_ns is not None]
            wait_s = max(0.0, (min(due_ns) - time.monotonic_ns()) * 1e-9) if due_ns else _IDLE_S
            ready = select.select([*(come for come, _, _ in self._routes), 0], [], [], wait_s)[0]
            round_s = time.monotonic()
            for come, way, _ in self._routes:
                if come in ready:
                    _read(come, way)
            for _, way, go in self._routes:
                _write(go, way)
            if 0 in ready and not self._obey():
                return
            time.sleep(max(0.0, round_s + _GRAIN_S - time.monotonic()))

    def _obey(self) -> bool:
        """Does the orders that have come; False at the end of the standard input."""
        data = os.read(0, 65_536)
        *lines, self._orders = (self._orders + data).split(b"\n")
        for line in lines:
            answer = self._do(**json.loads(line))
            print(json.dumps({"at_ns": time.monotonic_ns(), **answer}), flush=True)
        return bool(data)

    def _do(self, do: str, way: str = "both", **order: Any) -> dict[str, Any]:  # noqa: ANN401
        if do == "count":
            return {name: dict(one.counts) for name, one in self._ways.items()}
        for one in self._ways.values() if way == "both" else [self._ways[way]]:
            match do:
                case "shape":
                    settings = checked(ImpairmentSettings, order["settings"], "shape")
                    one.shape(settings, order["largest_bytes"])
                case "stall":
                    one.stall(time.monotonic_ns(), order["stall_s"])
                case "cut" | "mend" | "forget":
                    getattr(one, do)()
                case _:
                    raise ValueError(f"order {do!r}")
        return {}


def _read(end: int, way: Way) -> None:
    for _ in range(_MOST_AT_ONCE):
        try:
            packet = os.read(end, _MTU)
        except BlockingIOError:
            return
        way.offer(packet, time.monotonic_ns())


def _write(end: int, way: Way) -> None:
    for packet in way.take(time.monotonic_ns()):
        try:
            os.write(end, packet)
        except OSError:  # the device is down, or its queue is full: lost, as on any cable
            way.counts["unwritten"] += 1


def main() -> None:
    a, b, seed = map(int, sys.argv[1:])
    prepare_thread(_PRIORITY)
    print(json.dumps({"at_ns": time.monotonic_ns()}), flush=True)
    Forwarder((a, b), seed).run()


if __name__ == "__main__":
    main()
