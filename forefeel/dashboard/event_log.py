"""The events of a cell, as lines of a list. Pure; texts of the network are made printable."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from forefeel.common.events.console import printable
from forefeel.common.events.text import event_text
from forefeel.common.messages import EmergencyStop, Handshake, MasterEvent, Message, SafetyEvent, SafetyState
from forefeel.dashboard.levels import BAD, BUSY, GOOD, OFF, WARN, Level

MOST = 200  # lines that are kept
_AFTER: dict[str, Level] = {
    SafetyState.IDLE: OFF,
    SafetyState.READY: OFF,
    SafetyState.ENGAGING: BUSY,
    SafetyState.ARMED: GOOD,
    SafetyState.STOPPING: WARN,
    SafetyState.FAULT: BAD,
    SafetyState.ESTOPPED: BAD,
    "no_session": BAD,
    "in_session": GOOD,
    "handle_fault": BAD,
    "failed": BAD,
}


class EventLine(NamedTuple):
    """`number` grows by one from line to line; `receive_ns`: when it was heard."""

    number: int
    receive_ns: int
    level: Level
    who: str
    text: str


class EventList:
    def __init__(self) -> None:
        self.count = 0
        self._lines: deque[EventLine] = deque(maxlen=MOST)

    def __iter__(self) -> Iterator[EventLine]:
        return iter(self._lines)

    def hear(self, message: Message, role: str, receive_ns: int) -> None:
        """A message of `role`; what is no event is passed over."""
        text = event_text(message)
        if text:
            self.count += 1
            line = EventLine(self.count, receive_ns, _level(message), role, printable(text))
            self._lines.append(line)


def _level(event: Message) -> Level:
    match event:
        case SafetyEvent() | MasterEvent():
            return _AFTER.get(event.after, WARN)
        case EmergencyStop():
            return BAD
        case Handshake(accepted=True):
            return OFF
        case _:
            return WARN
