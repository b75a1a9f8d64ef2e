"""Lines from a daemon for the person at its terminal, or for the journal."""

from collections.abc import Callable, Mapping
from contextlib import suppress

from forefeel.common.slots import BoundedQueue

_REPEAT_NS = 5_000_000_000
"""A cause that lasts is told anew after this long: often enough to be read while it holds."""
_WAITING = 10
"""More lines at once are not read, and fill the journal: the oldest are lost."""


def printable(text: str) -> str:
    """`text` with a question mark for what could control a terminal; it may come from the network."""
    return "".join(c if c.isprintable() else "?" for c in text)


class Notices:
    """The lines of one axis that wait for the console. Filled by any thread, drained by one."""

    def __init__(self) -> None:
        self._queue: BoundedQueue[str] = BoundedQueue(_WAITING)
        self._repeated_ns: int | None = None

    def add(self, text: str) -> None:
        self._queue.put(printable(text))

    def repeat(self, text: str, now_ns: int) -> None:
        """Adds a line for the one cause that lasts: at the first call, then at most every 5 s."""
        if self._repeated_ns is None or now_ns - self._repeated_ns >= _REPEAT_NS:
            self._repeated_ns = now_ns
            self.add(text)

    def drain(self) -> list[str]:
        return self._queue.drain()


def tell_notices(role: str, notices: Mapping[str, Notices], say: Callable[[str], None]) -> None:
    """Passes each waiting line of a daemon's axes to `say`, once, after role and axis; an OSError of `say`,
    as of a terminal that is gone, is ignored.
    """
    for name, waiting in notices.items():
        for text in waiting.drain():
            with suppress(OSError):
                say(f"{role}: axis {name}: {text}")
