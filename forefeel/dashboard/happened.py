"""What happened in a cell, as lines of a list. Pure; texts of the network are made printable."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from forefeel.common.messages import (
    EmergencyStop,
    Handshake,
    LimitEvent,
    MasterEvent,
    Message,
    SafetyEvent,
    SafetyState,
)
from forefeel.common.notices import printable
from forefeel.dashboard.levels import BAD, BUSY, GOOD, OFF, WARN, Level
from forefeel.report.wording import quantity

MOST = 200  # lines that are kept; chosen, not measured: older ones stand in a recording
_AFTER: dict[str, Level] = {
    SafetyState.IDLE: OFF,
    SafetyState.READY: OFF,
    SafetyState.ENGAGING: BUSY,
    SafetyState.ARMED: GOOD,
    SafetyState.STOPPING: WARN,
    SafetyState.FAULT: BAD,
    SafetyState.ESTOPPED: BAD,
    "no_link": BAD,
    "linked": GOOD,
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


class Happened:
    """The newest lines."""

    def __init__(self) -> None:
        self.count = 0
        self._lines: deque[EventLine] = deque(maxlen=MOST)

    def __iter__(self) -> Iterator[EventLine]:
        return iter(self._lines)

    def hear(self, message: Message, role: str, receive_ns: int) -> None:
        """An event, said by `role`; anything else is passed over."""
        said = _said(message)
        if said is None:
            return
        self.count += 1
        level, text = said
        self._lines.append(EventLine(self.count, receive_ns, level, role, printable(text)))


def _said(message: Message) -> tuple[Level, str] | None:
    match message:
        case SafetyEvent() | MasterEvent():
            change = f"{_word(message.before)} → {_word(message.after)}"
            return _AFTER.get(message.after, WARN), f"{change} · {_word(message.event)}: {message.reason}"
        case LimitEvent():
            return WARN, _limit(message)
        case EmergencyStop():
            return BAD, f"emergency stop by {message.source}: {message.reason}"
        case Handshake() if message.role == "slave":
            if message.accepted:
                return OFF, "session accepted"
            return WARN, f"session refused: {message.reason}"
        case _:
            return None


def _limit(event: LimitEvent) -> str:
    asked, applied = quantity(event.requested, event.unit), quantity(event.applied, event.unit)
    times = f", {event.count} times" if event.count > 1 else ""
    return f"limit {_word(event.rule)}: asked {asked}, applied {applied}{times}"


def _word(name: str) -> str:
    return str(name).replace("_", " ")
