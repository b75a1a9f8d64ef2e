"""What every way has: an end that echoes and an end that measures; 1 kHz, one process each."""

import asyncio
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from pathlib import Path
from statistics import quantiles

from benchmarks.gated import command

PERIOD_S = 1e-3  # s between two messages: the 1 kHz of commands and forces
TO = "forefeel.bench.to"
"""The service that a way with names has."""


class Stopwatch:
    """Round trips in us; an answer is the question's own bytes.

    Attributes:
        times_us: of those answered so far.
    """

    def __init__(self) -> None:
        self.times_us: list[float] = []
        self._sent_ns: dict[bytes, int] = {}
        self._number = 0

    def ask(self) -> bytes:
        """The next payload; the time runs from here."""
        self._number += 1
        payload = command(self._number)
        self._sent_ns[payload] = time.perf_counter_ns()
        return payload

    def answered(self, payload: bytes) -> None:
        """A question came back."""
        sent_ns = self._sent_ns.pop(payload, None)
        if sent_ns is not None:
            self.times_us.append((time.perf_counter_ns() - sent_ns) * 1e-3)

    @property
    def open(self) -> int:
        """Questions without an answer."""
        return len(self._sent_ns)

    def restart(self) -> None:
        """Forgets what was measured; numbers go on."""
        self.times_us.clear()
        self._sent_ns.clear()


class Way(ABC):
    """A way for messages. An instance lives in one process, as the echo or as the one that measures.

    Attributes:
        name: in the table.
    """

    name: str

    def __init__(self, port: int, pki: Path) -> None:
        self.port, self.pki = port, pki

    @abstractmethod
    def version(self) -> str:
        """The version of the library."""

    @abstractmethod
    def echo(self, ready: Callable[[], None]) -> None:
        """Sends back what comes, until the standard input ends."""

    @abstractmethod
    def measure(self, warm: int, count: int) -> list[float]:
        """Round trips in us at 1 kHz, after `warm` that do not count."""


class AsyncWay(Way):
    """A way that lives in asyncio; the measuring end paces itself there."""

    async def paced(self, send: Callable[[bytes], Awaitable[object]], watch: Stopwatch, count: int) -> None:
        """Asks every millisecond, and waits for the last answers."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        for _ in range(count):
            due_s += PERIOD_S
            await asyncio.sleep(max(0.0, due_s - loop.time()))
            await send(watch.ask())
        end_s = loop.time() + 2.0
        while watch.open and loop.time() < end_s:  # noqa: ASYNC110 - of callbacks that know no event
            await asyncio.sleep(0.01)

    async def warmed(
        self, send: Callable[[bytes], Awaitable[object]], watch: Stopwatch, warm: int, count: int
    ) -> list[float]:
        """The times of `count` round trips in us, after `warm` that do not count."""
        await self.paced(send, watch, warm)
        watch.restart()
        await self.paced(send, watch, count)
        return list(watch.times_us)


async def input_ended() -> None:
    """Waits until the standard input ends."""
    await asyncio.to_thread(sys.stdin.read)


def paced(send: Callable[[bytes], object], watch: Stopwatch, count: int) -> None:
    """Asks every millisecond as `AsyncWay.paced` does, in a plain thread."""
    due_s = time.perf_counter()
    for _ in range(count):
        due_s += PERIOD_S
        time.sleep(max(0.0, due_s - time.perf_counter()))
        send(watch.ask())
    end_s = time.perf_counter() + 2.0
    while watch.open and time.perf_counter() < end_s:
        time.sleep(0.01)


def summary(times_us: list[float]) -> tuple[float, float, float]:
    """(p50, p99, p99.9) in us."""
    cuts = quantiles(times_us, n=1000, method="inclusive")
    return cuts[499], cuts[989], cuts[998]
