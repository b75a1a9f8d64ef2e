"""What certificates and the gate cost, beside plain Zenoh in the same run: `python -m benchmarks.security`.

Two processes on this machine, one echoes. Round trips back to back, and paced at 1 kHz. Variants take turns
within each round; the figure is the median over the rounds of the ratio to plain TCP of the same round.
"""

import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import zenoh

from benchmarks.gated import command, gated
from forefeel.common.clock import MonotonicClock
from forefeel.common.runtime.realtime import prepare_process
from forefeel.common.topics import COMMAND, FORCE, Qos
from forefeel.common.transport.port import Put
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.live_cell import free_port
from tests.secured import make_pki

_CELL = "cell"
_ROUNDS, _BACK_TO_BACK_TRIPS, _PACED_TRIPS = 7, 1500, 1000  # rounds, and round trips of each kind in one
_CLOCK = MonotonicClock()


@dataclass(frozen=True, slots=True)
class Variant:
    """`axis`: what the other end does with it. `command`: a MotionCommand instead of 64 bytes."""

    name: str
    link: str
    axis: str
    command: bool


VARIANTS = (
    Variant("Zenoh tcp, 64 bytes", "tcp", "echo", False),
    Variant("mTLS and access control, 64 bytes", "tls", "echo", False),
    Variant("Zenoh tcp, a command unread", "tcp", "echo", True),
    Variant("tcp, decoded, validated, gated", "tcp", "gate", True),
    Variant("tcp, the same by way of the ring", "tcp", "ring", True),
    Variant("mTLS, decoded, validated, gated", "tls", "gate", True),
    Variant("mTLS, the same by way of the ring", "tls", "ring", True),
)


def main() -> None:
    """Prints one line a variant."""
    prepare_process()
    with tempfile.TemporaryDirectory() as folder, _other_end(Path(folder)) as ends:
        channels = {variant: _Channel(ends[variant.link], variant) for variant in VARIANTS}
        for channel in channels.values():
            channel.await_answer()
        rounds = [
            {variant: (channel.back_to_back(), channel.paced()) for variant, channel in channels.items()}
            for _ in range(_ROUNDS)
        ]
        for channel in channels.values():
            channel.close()
    _table(rounds)


def _table(rounds: list[dict[Variant, tuple[list[float], list[float]]]]) -> None:
    print(
        f"{'':>36} {'back to back, us':>17} {'ratio':>6} {'paced 1 kHz, us':>17} {'ratio':>6}\n"
        f"{'':>36} {'p50 / p99':>17} {'p50':>6} {'p50 / p99':>17} {'p50':>6}"
    )
    plain = VARIANTS[0]
    for variant in VARIANTS:
        cells = []
        for mode in (0, 1):
            p50 = median(_quantile(each[variant][mode], 0.50) for each in rounds)
            p99 = median(_quantile(each[variant][mode], 0.99) for each in rounds)
            ratio = median(
                _quantile(each[variant][mode], 0.50) / _quantile(each[plain][mode], 0.50) for each in rounds
            )
            cells.append(f"{p50:8.0f} /{p99:7.0f} {ratio:6.2f}")
        print(f"{variant.name:>36} {'  '.join(cells)}", flush=True)


def _quantile(times_us: list[float], q: float) -> float:
    return sorted(times_us)[int(q * (len(times_us) - 1))]


class _Channel:
    """One variant as its sender sees it."""

    def __init__(self, transport: ZenohTransport, variant: Variant) -> None:
        self._variant = variant
        self._numbers = 0
        self._sent_ns: deque[int] = deque()
        self._times_us: list[float] = []
        self._answered = threading.Semaphore(0)
        session: Any = getattr(transport, "_session")  # noqa: B009 - below the product's own rings
        axis = f"{variant.axis}-{int(variant.command)}"
        self._put = transport.publisher(COMMAND.taken_key(_CELL, axis), Qos.STREAM)
        self._subscriber: Any = session.declare_subscriber(FORCE.taken_key(_CELL, axis), self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        del sample
        self._times_us.append((time.perf_counter_ns() - self._sent_ns.popleft()) * 1e-3)
        self._answered.release()

    def close(self) -> None:
        self._subscriber.undeclare()

    def _send(self) -> None:
        self._numbers += 1
        payload = bytes(64)
        self._sent_ns.append(time.perf_counter_ns())
        if self._variant.command:  # what it costs to say it is the sender's in every variant
            payload = command(self._numbers)
        self._put(payload)

    def await_answer(self) -> None:
        """Until both ends know each other; the first may be lost."""
        while True:
            self._sent_ns.clear()
            self._send()
            if self._answered.acquire(timeout=0.2):
                break
        time.sleep(0.3)
        self._clear()

    def _clear(self) -> None:
        self._sent_ns.clear()
        self._times_us.clear()
        while self._answered.acquire(blocking=False):
            pass

    def back_to_back(self) -> list[float]:
        """Round trips in us, each after the one before."""
        self._clear()
        for _ in range(_BACK_TO_BACK_TRIPS):
            self._send()
            if not self._answered.acquire(timeout=2.0):
                raise SystemExit(f"{self._variant.name}: no answer")
        return list(self._times_us)

    def paced(self) -> list[float]:
        """Round trips in us, one begun every millisecond."""
        self._clear()
        due_s = time.perf_counter()
        for _ in range(_PACED_TRIPS):
            due_s += 1e-3
            time.sleep(max(0.0, due_s - time.perf_counter()))
            self._send()
        time.sleep(0.1)
        return list(self._times_us)


@contextmanager
def _other_end(folder: Path) -> Iterator[dict[str, ZenohTransport]]:
    """The echo's process, and our sessions with it."""
    make_pki(folder / "pki", [_CELL])
    ports = [free_port(), free_port()]
    command = [sys.executable, "-m", "benchmarks.security", "echo", str(folder), *map(str, ports)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        ends = _ends(folder, ports, listens=False)
        try:
            yield ends
        finally:
            for end in ends.values():
                end.close()
            assert process.stdin is not None
            process.stdin.close()


def _ends(folder: Path, ports: list[int], listens: bool) -> dict[str, ZenohTransport]:
    """A session of each kind."""
    found = {}
    for link, port in zip(("tcp", "tls"), ports, strict=True):
        endpoint = (f"{link}/127.0.0.1:{port}",)
        pki = folder / "pki" if link == "tls" else None
        settings = TransportSettings(
            listen=endpoint if listens else (), connect=() if listens else endpoint, pki=pki
        )
        party = Party("slave" if listens else "master", (_CELL,))
        found[link] = ZenohTransport.open(settings, _CLOCK, _raise, party)
    return found


def _raise(error: BaseException) -> None:
    raise error


def _echo(folder: Path, ports: list[int]) -> None:
    """Echoes until the standard input ends."""
    prepare_process()
    declared: list[Any] = []
    ends = _ends(folder, ports, listens=True)
    for transport in ends.values():
        session: Any = getattr(transport, "_session")  # noqa: B009
        for axis in ("echo-0", "echo-1", "gate-1", "ring-1"):
            put = transport.publisher(FORCE.taken_key(_CELL, axis), Qos.STREAM)
            receive = _answer(put, axis)
            key = COMMAND.taken_key(_CELL, axis)
            if axis.startswith("ring"):
                transport.subscribe(key, receive)
            else:
                declared.append(session.declare_subscriber(key, _callback(receive)))
    sys.stdin.read()
    for subscriber in declared:
        subscriber.undeclare()
    for transport in ends.values():
        transport.close()


def _callback(receive: Callable[[bytes, int], None]) -> Callable[[zenoh.Sample], None]:
    return lambda sample: receive(sample.payload.to_bytes(), _CLOCK.now_ns())


def _answer(put: Put, axis: str) -> Callable[[bytes, int], None]:
    """What is done before the answer: nothing, or what the slave does with every command."""
    answer = bytes(64)
    if axis.startswith("echo"):
        return lambda payload, _receive_ns: put(answer)
    return gated(put, answer)


if __name__ == "__main__":
    if sys.argv[1:2] == ["echo"]:
        _echo(Path(sys.argv[2]), [int(port) for port in sys.argv[3:5]])
    else:
        main()
