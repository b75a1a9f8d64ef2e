"""Memory of the flight recorder: the newest seconds of each stream. Pure; nothing is encoded here.

A ring for each key, so that a flood on one washes out no other. Rings are filled by any thread with tuples
whose first member is their stamp, and read by the one that writes a record.
"""

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from forefeel.common.messages import Grip, Message, SafetyState
from forefeel.common.topics import Qos, Topic, parse_key

BEFORE_NS = 2_000_000_000  # ns recorded before the event
AFTER_NS = 500_000_000  # ns recorded after the event
_SPARE_S = 1.5
"""For a writer that comes late."""
_EVENT_ROWS = 256  # rows of a topic that has no rate
_LARGEST = {Qos.STREAM: 1024, Qos.STATE: 16_384, Qos.EVENT: 8192}
"""Longer payloads, in bytes, are no message of ours on such a topic."""

Row = tuple[Any, ...]
_COPY_ATTEMPTS = 8  # attempts to copy a ring to which rows are added


class FlightRing:
    """The newest rows of one key.

    Attributes:
        add: takes a row `(stamp_ns, ...)`; a C function, for it is called at full rate.
    """

    def __init__(self, key: str, topic: Topic[Message]) -> None:
        self.key = key
        self.largest = _LARGEST[topic.qos]
        seconds = (BEFORE_NS + AFTER_NS) * 1e-9 + _SPARE_S
        self._rows: deque[Row] = deque(
            maxlen=_EVENT_ROWS if topic.rate_hz is None else int(seconds * topic.rate_hz) + 64
        )
        self.add: Callable[[Row], None] = self._rows.append

    def received(self, payload: bytes, receive_ns: int) -> None:
        """Adds a payload from the network, unless it is longer than any message of the topic."""
        if len(payload) <= self.largest:
            self.add((receive_ns, payload))

    def between(self, first_ns: int, last_ns: int) -> list[Row]:
        """Rows stamped from `first_ns` to `last_ns`, both included, in the order they were added. Empty where
        there are none, or where rows that are added meanwhile spoil all attempts to copy the ring.
        """
        for _ in range(_COPY_ATTEMPTS):
            try:
                rows = self._rows.copy()
            except RuntimeError:  # a row came while it was copied
                continue
            return [row for row in rows if first_ns <= row[0] <= last_ns]
        return []


class Rings:
    """Flight rings by key."""

    def __init__(self) -> None:
        self._rings: dict[str, FlightRing] = {}

    def ring(self, key: str) -> FlightRing:
        """The ring of a key, made where there is none; asserts that the key is of the topic table."""
        if key not in self._rings:
            parsed = parse_key(key)
            assert parsed is not None, key
            self._rings[key] = FlightRing(key, parsed[2])
        return self._rings[key]

    def all(self) -> list[FlightRing]:
        return list(self._rings.values())


class CycleRow(NamedTuple):
    """The fields of a `ControlCycle`, as the control loop notes them."""

    stamp_ns: int
    setpoint_m: float
    setpoint_velocity_m_s: float
    moving: bool
    position_m: float
    velocity_m_s: float
    force_n: float
    force_valid: bool
    state: SafetyState
    gripper: Grip
    executed_sequence: int | None
    session_id: int
