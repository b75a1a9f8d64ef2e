"""The events of a cell, as lines of a list. Pure; texts of the network are made printable."""

from collections import deque
from collections.abc import Iterator
from typing import Literal, NamedTuple

from forefeel.common.events.console import printable
from forefeel.common.events.text import CONTACT_LOST, event_text, notable
from forefeel.common.messages import (
    EmergencyStop,
    Handshake,
    LimitEvent,
    MasterEvent,
    Message,
    SafetyEvent,
    SafetyState,
)

MOST = 200  # lines that are kept
Level = Literal["good", "busy", "warn", "bad", "off"]
"""Status of something: a colour and a shape, never without a word."""
_AFTER: dict[str, Level] = {
    SafetyState.IDLE: "off",
    SafetyState.READY: "off",
    SafetyState.ENGAGING: "busy",
    SafetyState.ARMED: "good",
    SafetyState.FAULT: "bad",
    SafetyState.ESTOPPED: "bad",
    "no_session": "bad",
    "in_session": "good",
    "handle_fault": "bad",
    "failed": "bad",
}


class EventLine(NamedTuple):
    """`number` grows by one from line to line; `heard_s`: when, on the clock of who listens."""

    number: int
    heard_s: float
    level: Level
    who: str
    text: str


class EventList:
    """Lines of the newest `MOST` events, the oldest first; `count`: of all so far."""

    def __init__(self) -> None:
        self.count = 0
        self._lines: deque[EventLine] = deque(maxlen=MOST)

    def __iter__(self) -> Iterator[EventLine]:
        return iter(self._lines)

    def hear(self, message: Message, role: str, receive_ns: int) -> None:
        """Appends a line about an event of `role`; ignores other messages."""
        text = event_text(message)
        if text:
            self.add(_level(message), role, printable(text), receive_ns)

    def add(self, level: Level, role: str, text: str, receive_ns: int) -> None:
        self.count += 1
        self._lines.append(EventLine(self.count, round(receive_ns * 1e-9, 3), level, role, text))


def _level(event: Message) -> Level:
    """Level of an event's line: of a transition by the state it leads to, of stopping `busy` after a release
    and else `warn`; `bad` for an emergency stop, `off` for an accepted handshake and for a limit that is not
    `notable`, else `warn`, lost contact included.
    """
    match event:
        case SafetyEvent(after=SafetyState.STOPPING, event="release"):
            return "busy"
        case SafetyEvent() | MasterEvent():
            return _AFTER.get(event.after, "warn")
        case EmergencyStop():
            return "bad"
        case Handshake(accepted=True):
            return "off"
        case LimitEvent(rule=rule) if rule != CONTACT_LOST:
            return "warn" if notable(rule, event.requested, event.applied) else "off"
        case _:
            return "warn"
