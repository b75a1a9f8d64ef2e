"""What a daemon tells the person at its terminal, or the journal, in one line each."""

from collections.abc import Callable, Mapping
from contextlib import suppress

from forefeel.common.slots import BoundedQueue

_SECOND_NS = 1_000_000_000  # ns in a second, over which `ConsoleNotifier` counts its lines
_REPEAT_NS = 5 * _SECOND_NS
"""A cause that lasts is told anew after this long: often enough to be read while it holds."""
_PER_SECOND = 10
"""More lines than this are not read, and fill the journal."""


def printable(text: str) -> str:
    """`text` with a question mark for what could control a terminal; it may come from the network."""
    return "".join(c if c.isprintable() else "?" for c in text)


class Notices:
    """The lines of one axis that wait for the console. Filled by any thread, drained by one."""

    def __init__(self) -> None:
        self._queue: BoundedQueue[str] = BoundedQueue(64)
        self._repeated_ns: int | None = None

    def add(self, text: str) -> None:
        self._queue.put(printable(text))

    def repeat(self, text: str, now_ns: int) -> None:
        """Adds the one cause that lasts; at once, then every 5 s, however often it is called."""
        if self._repeated_ns is None or now_ns - self._repeated_ns >= _REPEAT_NS:
            self._repeated_ns = now_ns
            self.add(text)

    def drain(self) -> list[str]:
        """The lines since the last call, oldest first; the oldest of very many are lost."""
        return self._queue.drain()


class ConsoleNotifier:
    """Tells the notices of a daemon's axes, at most ten lines a second, and counts the others.

    Args:
        role: of the daemon.
        notices: by axis.
        tell: takes a line. A terminal that is gone stops nothing.
    """

    def __init__(self, role: str, notices: Mapping[str, Notices], tell: Callable[[str], None]) -> None:
        self._role, self._notices, self._tell = role, notices, tell
        self._second = self._lines = self._held_back = 0

    def serve(self, now_ns: int) -> None:
        """Tells what came since the last call; about ten times a second."""
        for name, notices in self._notices.items():
            for text in self._admitted(notices.drain(), now_ns):
                with suppress(OSError):
                    self._tell(f"{self._role}: axis {name}: {text}")

    def _admitted(self, texts: list[str], now_ns: int) -> list[str]:
        """Those that this second has room for, behind how many the last one had none for."""
        told = []
        if now_ns // _SECOND_NS != self._second:
            self._second, self._lines = now_ns // _SECOND_NS, 0
            if self._held_back:
                told.append(f"{self._held_back} more, not shown")
                self._held_back = 0
        room = max(0, _PER_SECOND - self._lines)
        self._lines += len(texts[:room])
        self._held_back += len(texts[room:])
        return told + texts[:room]
