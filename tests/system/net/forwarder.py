"""A cable in software: `python -m tests.system.net.forwarder NAMESPACE_A NAMESPACE_B SEED`.

A TUN device in each of the two namespaces, named as its namespace; IP packets go from one to the other
through a `Way`. Each line on the standard input is a JSON order, answered by a JSON line with the
CLOCK_MONOTONIC stamp at which it took effect: `{"do": "shape" | "stall" | "cut" | "mend" | "forget" |
"count", ...}`. It ends with the standard input.
"""

import fcntl
import json
import os
import select
import struct
import sys
import time
from typing import Any

from forefeel.common.config import checked
from forefeel.common.runtime.realtime import prepare_thread
from forefeel.common.transport.settings import ImpairmentSettings
from tests.system.net.namespaces import inside
from tests.system.net.shape import Way

_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_MTU = 65_535
_MOST_AT_ONCE = 64
_PRIORITY = 70  # a cable waits for no program of this machine
_IDLE_S = 1.0
_GRAIN_S = 0.0005
"""Of its rounds: packets that come together go together, or the cable takes a quarter of a processor."""


def open_tun(namespace: str) -> int:
    """A new TUN device in that namespace, of its name; gone when the descriptor is closed."""
    with inside(namespace):
        tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", namespace.encode(), _IFF_TUN | _IFF_NO_PI))
    return tun


class Forwarder:
    """Both ways of the cable."""

    def __init__(self, ends: tuple[int, int], seed: int) -> None:
        self._ends = ends
        self._ways = {"ab": Way(1000 * seed), "ba": Way(1000 * seed + 500)}
        self._orders = b""

    def run(self) -> None:
        a, b = self._ends
        ways = ((a, self._ways["ab"]), (b, self._ways["ba"]))
        outs = ((b, self._ways["ab"]), (a, self._ways["ba"]))
        while True:
            ready = select.select([a, b, 0], [], [], self._wait_s())[0]
            round_s = time.monotonic()
            for end, way in ways:
                if end in ready:
                    self._read(end, way)
            for end, way in outs:
                self._write(end, way)
            if 0 in ready and not self._obey():
                return
            time.sleep(max(0.0, round_s + _GRAIN_S - time.monotonic()))

    def _wait_s(self) -> float:
        due_ns = [way.next_ns for way in self._ways.values() if way.next_ns is not None]
        return max(0.0, (min(due_ns) - time.monotonic_ns()) * 1e-9) if due_ns else _IDLE_S

    def _read(self, end: int, way: Way) -> None:
        for _ in range(_MOST_AT_ONCE):
            try:
                packet = os.read(end, _MTU)
            except BlockingIOError:
                return
            way.offer(packet, time.monotonic_ns())

    def _write(self, end: int, way: Way) -> None:
        for _, packet in way.take(time.monotonic_ns()):
            try:
                os.write(end, packet)
            except OSError:  # the device is down, or its queue is full: lost, as on any cable
                way.counts["unwritten"] += 1

    def _obey(self) -> bool:
        data = os.read(0, 65_536)
        self._orders += data
        while b"\n" in self._orders:
            line, _, self._orders = self._orders.partition(b"\n")
            order = json.loads(line)
            answer = self._do(order)
            print(json.dumps({"at_ns": time.monotonic_ns(), **answer}), flush=True)
        return bool(data)

    def _do(self, order: dict[str, Any]) -> dict[str, Any]:
        way = order.get("way", "both")
        ways = list(self._ways.values()) if way == "both" else [self._ways[way]]
        match order["do"]:
            case "shape":
                settings = checked(ImpairmentSettings, order["settings"], "shape")
                for one in ways:
                    one.shape(settings, order.get("largest_bytes"))
            case "stall":
                for one in ways:
                    one.stall(time.monotonic_ns(), order["stall_s"])
            case "cut" | "mend" | "forget" as act:
                for one in ways:
                    getattr(one, act)()
            case "count":
                return {name: dict(way.counts) for name, way in self._ways.items()}
            case unknown:
                raise ValueError(f"order {unknown!r}")
        return {}


def main() -> None:
    a, b, seed = sys.argv[1:]
    ends = open_tun(a), open_tun(b)
    prepare_thread(_PRIORITY)
    print(json.dumps({"at_ns": time.monotonic_ns()}), flush=True)
    Forwarder(ends, int(seed)).run()


if __name__ == "__main__":
    main()
