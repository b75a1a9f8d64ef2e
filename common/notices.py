"""What a daemon has to tell the person at its terminal, in one line each."""

from typing import TYPE_CHECKING

from forefeel.common.slots import BoundedQueue

if TYPE_CHECKING:  # a stop speaks before pydantic is imported
    from forefeel.common.messages import SafetyEvent

_SECOND_NS = 1_000_000_000  # ns in a second, over which `RateLimit` counts its lines
_REPEAT_NS = 5_000_000_000
"""A cause that lasts is told anew after this long: often enough to be read while it holds."""
_ROUND_TRIP = "round trip "


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


def span(seconds: float) -> str:
    """A time that has passed: 3.2 s, 48 s, 2 min 05 s, 1 h 07 min."""
    if seconds < 10.0:
        return f"{max(seconds, 0.0):.1f} s"
    whole = int(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def long_round_trip(round_trip_s: float, limit_s: float) -> str:
    """Why an axis does not arm over a link that is too slow."""
    return f"{_ROUND_TRIP}{round_trip_s * 1e3:.0f} ms, limit {limit_s * 1e3:.0f} ms"


def is_long_round_trip(reason: str) -> bool:
    """Whether a reason is one of `long_round_trip`."""
    return reason.startswith(_ROUND_TRIP)


class Lasting:
    """Tells when a cause that lasts is to be said: at once, then every 5 s."""

    def __init__(self) -> None:
        self._said_ns: int | None = None

    def due(self, now_ns: int) -> bool:
        """Whether it is to be said now; True counts as said."""
        if self._said_ns is not None and now_ns - self._said_ns < _REPEAT_NS:
            return False
        self._said_ns = now_ns
        return True


def in_words(event: "SafetyEvent") -> str:
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
        if now_ns // _SECOND_NS != self._second:
            self._second, self._lines = now_ns // _SECOND_NS, 0
            if self._held_back:
                said.append(f"{self._held_back} more, not shown")
                self._held_back = 0
        room = max(0, self._per_second - self._lines)
        self._lines += len(texts[:room])
        self._held_back += len(texts[room:])
        return said + texts[:room]
