"""What a daemon has to tell the person at its terminal, in one line each."""

from common.messages import SafetyEvent
from common.slots import BoundedQueue

_NANOSECONDS = 1_000_000_000


def printable(text: str) -> str:
    """`text` with a question mark for what could speak to a terminal; it may come from the network."""
    return "".join(c if c.isprintable() else "?" for c in text)


class Notices:
    """Lines that wait for being said. Filled by any thread, drained by one."""

    def __init__(self) -> None:
        self._queue: BoundedQueue[str] = BoundedQueue(64)

    def add(self, text: str) -> None:
        """One line, made printable."""
        self._queue.put(printable(text))

    def drain(self) -> list[str]:
        """The lines since the last call, oldest first; the oldest of very many are lost."""
        return self._queue.drain()


def in_words(event: SafetyEvent) -> str:
    """A transition of the safety state machine in words."""
    return f"{event.before.value} -> {event.after.value}, {event.event}: {event.reason}"


class RateLimit:
    """Lets at most `per_second` lines of each second through, and counts the others."""

    def __init__(self, per_second: int = 10) -> None:
        self._per_second = per_second
        self._second = 0
        self._lines = 0
        self._held_back = 0

    def passed(self, texts: list[str], now_ns: int) -> list[str]:
        """Those of `texts` that may be said now, and how many could not before."""
        said = []
        if now_ns // _NANOSECONDS != self._second:
            self._second, self._lines = now_ns // _NANOSECONDS, 0
            if self._held_back:
                said.append(f"{self._held_back} more, not shown")
                self._held_back = 0
        room = max(0, self._per_second - self._lines)
        self._lines += len(texts[:room])
        self._held_back += len(texts[room:])
        return said + texts[:room]
