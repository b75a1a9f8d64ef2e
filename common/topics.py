"""One table of topics: key expression, message, direction, rate, quality of service, staleness limit,
recorded or not.

Publishers, subscribers, watchdogs, the recorder and the report all read it; nothing else spells a key.
"""

import re
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Generic, Literal, TypeVar

from forefeel.common import messages as m
from forefeel.common.errors import ConfigurationError

Role = Literal["master", "slave"]
M_co = TypeVar("M_co", bound=m.Message, covariant=True)


class Qos(Enum):
    STREAM = "newest counts: real-time priority, express, dropped when congested"
    STATE = "periodic state: dropped when congested"
    EVENT = "rare and important: interactive priority, a queue of its own"


@dataclass(frozen=True, slots=True)
class Topic(Generic[M_co]):
    """One row of the table. `rate_hz` None: on occasion. `stale_after_s` None: never stale.

    `crosses`: the other end consumes it. What does not cross is published for the recorder only.
    `published`: it goes over the network; what does not stands in flight records only.
    `ordered`: the other end needs each of them, in order, so that they go over one connection; what is not
    carries its own number or is repeated, and may take turns between parallel connections.
    """

    name: str
    message: type[M_co]
    publisher: Literal["master", "slave", "any"]
    rate_hz: float | None
    qos: Qos
    stale_after_s: float | None = None
    recorded: bool = True
    crosses: bool = True
    published: bool = True
    ordered: bool = False

    @property
    def batched(self) -> bool:
        """True if observers receive it in batches, which cost them less; see `direct`."""
        return self.qos is Qos.STREAM and self.published

    @property
    def takes_turns(self) -> bool:
        """True if it may go over any of several connections to the other end."""
        return self.crosses and self.published and not self.ordered

    def key(self, cell: str, axis: str) -> str:
        """The Zenoh key expression of this topic for one axis of one cell."""
        return f"forefeel/{cell}/{axis}/{self.name}"

    def taken_key(self, cell: str, axis: str) -> str:
        """Key under which the other end takes it, see `direct`."""
        key = self.key(cell, axis)
        return direct(key) if self.batched else key


COMMAND = Topic("master/command", m.MotionCommand, "master", 1000, Qos.STREAM, 0.060)
FORCE = Topic("slave/force", m.ForceSample, "slave", 1000, Qos.STREAM, 0.100)
HAPTICS = Topic("master/haptics", m.HapticSample, "master", 1000, Qos.STREAM, crosses=False)
PARAMETERS = Topic("master/parameters", m.ModelParameters, "master", 20, Qos.STATE, crosses=False)
SLAVE_STATE = Topic("slave/state", m.SlaveState, "slave", 50, Qos.STATE, 0.5)
MASTER_STATE = Topic("master/state", m.MasterState, "master", 10, Qos.STATE, 0.5)
MASTER_HANDSHAKE = Topic("master/handshake", m.Handshake, "master", None, Qos.EVENT)
SLAVE_HANDSHAKE = Topic("slave/handshake", m.Handshake, "slave", None, Qos.EVENT)
MASTER_HEARTBEAT = Topic("master/heartbeat", m.Heartbeat, "master", 20, Qos.STATE, 1.0, recorded=False)
SLAVE_HEARTBEAT = Topic("slave/heartbeat", m.Heartbeat, "slave", 20, Qos.STATE, 1.0, recorded=False)
LIMIT_EVENT = Topic("slave/limit", m.LimitEvent, "slave", None, Qos.EVENT, ordered=True)
MASTER_LIMIT = Topic("master/limit", m.LimitEvent, "master", None, Qos.EVENT, crosses=False)
MASTER_EVENT = Topic("master/event", m.MasterEvent, "master", None, Qos.EVENT, crosses=False)
SAFETY_EVENT = Topic("slave/safety", m.SafetyEvent, "slave", None, Qos.EVENT, ordered=True)
CALIBRATION = Topic("slave/calibration", m.Calibration, "slave", None, Qos.EVENT, crosses=False)
SHAPE = Topic("slave/shape", m.InstrumentShape, "slave", 20, Qos.STATE, crosses=False)
EMERGENCY_STOP = Topic("any/estop", m.EmergencyStop, "any", None, Qos.EVENT)
MASTER_TIMING = Topic("master/timing", m.LoopTiming, "master", 1, Qos.STATE, crosses=False)
SLAVE_TIMING = Topic("slave/timing", m.LoopTiming, "slave", 1, Qos.STATE, crosses=False)
MASTER_IMPAIRMENT = Topic("master/impairment", m.ImpairmentTrace, "master", 10, Qos.STATE, crosses=False)
SLAVE_IMPAIRMENT = Topic("slave/impairment", m.ImpairmentTrace, "slave", 10, Qos.STATE, crosses=False)
CONTROL_CYCLE = Topic(
    "slave/cycle", m.ControlCycle, "slave", 1000, Qos.STREAM, recorded=False, crosses=False, published=False
)

TOPICS: tuple[Topic[m.Message], ...] = (
    COMMAND, FORCE, HAPTICS, PARAMETERS, SLAVE_STATE, MASTER_STATE, MASTER_HANDSHAKE, SLAVE_HANDSHAKE,
    MASTER_HEARTBEAT, SLAVE_HEARTBEAT, LIMIT_EVENT, SAFETY_EVENT, MASTER_LIMIT, MASTER_EVENT, CALIBRATION,
    EMERGENCY_STOP, MASTER_TIMING, SLAVE_TIMING, MASTER_IMPAIRMENT,
    SLAVE_IMPAIRMENT, SHAPE, CONTROL_CYCLE,
)  # fmt: skip

BY_NAME: dict[str, Topic[m.Message]] = {topic.name: topic for topic in TOPICS}
RECORDED = tuple(topic for topic in TOPICS if topic.recorded)
PUBLISHED = tuple(topic for topic in TOPICS if topic.published)


def direct(key: str) -> str:
    """Key under which the other end takes a batched topic message by message; observers get batches under
    `key`. Outside `forefeel/`, so that nobody who watches a cell receives a message twice.
    """
    return f"{_DIRECT}{key}"


_DIRECT = "direct/"


def numbered(number: int | str, key: str) -> str:
    """`key` as it goes over the connection of that number; "*" for all of them. Outside `forefeel/`, too."""
    return f"connection/{number}/{key}"


_SEGMENT = re.compile(r"[^@*$?#/\s][^*$?#/\s]*")


def checked_segment(text: str, what: str) -> str:
    """`text` when it can stand as one segment of a key expression.

    Raises:
        ConfigurationError: empty, a slash, or a character that Zenoh gives a meaning (`*`, `$`, `?`, `#`).
    """
    if not _SEGMENT.fullmatch(text):
        raise ConfigurationError(f"{what} = {text!r}: expected one key segment without / * $ ? # or blanks")
    return text


@lru_cache(maxsize=1024)
def parse_key(key: str) -> tuple[str, str, Topic[m.Message]] | None:
    """Cell, axis and topic of a concrete key, plain or `direct`; None when it is none of the topic table."""
    parts = key.removeprefix(_DIRECT).split("/", 3)
    if len(parts) != 4 or parts[0] != "forefeel" or parts[3] not in BY_NAME:
        return None
    if not (_SEGMENT.fullmatch(parts[1]) and _SEGMENT.fullmatch(parts[2])):
        return None
    return parts[1], parts[2], BY_NAME[parts[3]]


def crossing(key: str) -> Topic[m.Message] | None:
    """The topic of a key that the other end takes; None where observers alone hear it, or nobody."""
    parsed = parse_key(key)
    if parsed is None or not parsed[2].crosses or (parsed[2].batched and not key.startswith(_DIRECT)):
        return None
    return parsed[2]
