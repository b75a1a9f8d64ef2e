"""Traffic of a cell of which every figure is known, and the view that a page has of it."""

from collections.abc import Iterator
from typing import Any

from forefeel.common import topics
from forefeel.common.codec import encode
from forefeel.common.messages import Message
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.cell_view import CellView
from tests.messages import force, haptics, usual

MS = 1_000_000
S = 1000 * MS
CELL, AXIS = "cathlab", "insertion"
AHEAD_NS = 40 * S
"""So much is the slave's clock ahead of the master's."""
HOSTILE = "<img src=x onerror=\"document.title='taken'\"><b>bold</b>"
Spoken = tuple[topics.Topic[Any], Message, int]


def talk(first: int, last: int, start_ns: int = 9 * S, delay_ms: int = 300) -> Iterator[Spoken]:
    """A cell at 1 kHz, from tick to tick: topic, message, receive stamp. Forces answer after `delay_ms`."""
    for tick in range(first, last):
        now_ns = start_ns + tick * MS
        put: list[tuple[topics.Topic[Any], Message]] = [(topics.HAPTICS, haptics(tick, now_ns))]
        sent = tick - delay_ms
        if sent >= 0:
            answered = (sent, start_ns + sent * MS)
            put.append((topics.FORCE, force(tick, answered[1] + delay_ms * MS // 2 + AHEAD_NS, answered)))
        if tick % 50 == 0:
            put += [
                (t, usual(t, stamp_ns=now_ns))
                for t in (topics.PARAMETERS, topics.SLAVE_STATE, topics.MASTER_STATE)
            ]
        if tick % 1000 == 0:
            put += [
                (topics.MASTER_TIMING, usual(topics.MASTER_TIMING)),
                (topics.LIMIT_EVENT, usual(topics.LIMIT_EVENT)),
            ]
        yield from ((topic, written, now_ns + 2 * MS) for topic, written in put)


def receive(cell: CellView, spoken: Iterator[Spoken], axis: str = AXIS) -> int:
    """Hands all to the view as from the network; the last receive stamp."""
    now_ns = 0
    for topic, written, now_ns in spoken:
        cell.hear(topic.key(CELL, axis), encode(written), now_ns)
    return now_ns


def viewed(seconds: float = 3.0) -> tuple[AxisView, int]:
    """An axis after so long, and the time."""
    cell = CellView()
    now_ns = receive(cell, talk(1, round(1000 * seconds)))
    return cell.axes[AXIS], now_ns
