"""One table of ROS topics, named as by CRTK (crtk-robotics.readthedocs.io), and the messages for it."""

import re
from collections.abc import Callable
from typing import Any, NamedTuple

from forefeel.common.bus import observed
from forefeel.common.codec import counted
from forefeel.common.errors import CodecError
from forefeel.common.messages import ForceSample, HapticSample, SafetyState, SlaveState
from forefeel.common.topics import FORCE, HAPTICS, SLAVE_STATE, Topic, parse_key
from forefeel.ros import cdr

_MOST_AXES = 32  # whose names come from the network
_STALE_NS = int((SLAVE_STATE.stale_after_s or 0.5) * 1e9)
_CRTK = {
    SafetyState.IDLE: "DISABLED",
    SafetyState.ESTOPPED: "PAUSED",  # powered, not to be moved, left by an explicit act alone
    SafetyState.FAULT: "FAULT",
}
_MOVES = frozenset({SafetyState.ENGAGING, SafetyState.ARMED, SafetyState.STOPPING})

Send = Callable[[bytes, int], None]
"""Takes CDR bytes and their stamp in ns since 1970."""
Take = Callable[[bytes, bytes], None]
"""Gets CDR bytes and the number of who wrote them."""
Advertise = Callable[[str, cdr.RosType], Send]
"""Makes the publisher of a topic."""


class RosTopic(NamedTuple):
    """Row of the table. `encode` takes a message of `source`, a header and the axis; None: nothing to say."""

    name: str
    type: cdr.RosType
    source: Topic[Any]
    encode: Callable[[Any, cdr.RosHeader, str], bytes | None]


def _measured_js(sample: ForceSample, header: cdr.RosHeader, axis: str) -> bytes:
    return cdr.joint_state(header, axis, sample.position_m, sample.velocity_m_s)


def _setpoint_js(sample: ForceSample, header: cdr.RosHeader, axis: str) -> bytes | None:
    return None if sample.setpoint_m is None else cdr.joint_state(header, axis, sample.setpoint_m)


def _measured_cf(sample: ForceSample, header: cdr.RosHeader, _axis: str) -> bytes | None:
    return cdr.wrench_stamped(header, sample.force_n) if sample.valid else None


def _predicted_cf(sample: HapticSample, header: cdr.RosHeader, _axis: str) -> bytes | None:
    return None if sample.predicted_n is None else cdr.wrench_stamped(header, sample.predicted_n)


def _operating_state(state: SlaveState, header: cdr.RosHeader, _axis: str) -> bytes:
    homed = state.state is not SafetyState.FAULT  # a slave starts with a homed stage alone
    return cdr.operating_state(header, _CRTK.get(state.state, "ENABLED"), homed, state.state in _MOVES)


TABLE = (
    RosTopic("measured_js", cdr.JOINT_STATE, FORCE, _measured_js),
    RosTopic("setpoint_js", cdr.JOINT_STATE, FORCE, _setpoint_js),
    RosTopic("body/measured_cf", cdr.WRENCH_STAMPED, FORCE, _measured_cf),
    RosTopic("body/predicted_cf", cdr.WRENCH_STAMPED, HAPTICS, _predicted_cf),
    RosTopic("operating_state", cdr.OPERATING_STATE, SLAVE_STATE, _operating_state),
)
DEPTH = 100
"""Messages that a publisher keeps: 0.5 s of a topic. Of 10 a busy machine lost 0.5 % over DDS, in bursts."""
STATE_COMMAND, SERVO_JP, DIAGNOSTICS = "state_command", "servo_jp", "/diagnostics"
_SOURCES = {row.source.name for row in TABLE}


def ros_name(cell: str, axis: str, topic: str) -> str:
    """Name of a topic of an axis; what ROS allows in no name becomes `_`."""
    words = (re.sub(r"\W", "_", word, flags=re.ASCII) for word in (cell, axis))
    return "/" + "/".join((*(f"_{word}" if word[0].isdigit() else word for word in words), topic))


class RosFeed:
    """Publishes what is received of a cell as ROS messages, with the stamps of their ticks: of a topic that
    comes in batches only `rate_hz` messages a second, of the others every one.

    Attributes:
        states: newest state of each axis, with its receive stamp.
    """

    def __init__(
        self, cell: str, rate_hz: float, epoch_ns: Callable[[int], int], advertise: Advertise
    ) -> None:
        """`epoch_ns`: turns a receive stamp into ns since 1970."""
        self.states: dict[str, tuple[SlaveState, int]] = {}
        self._cell, self._rate_hz, self._epoch_ns, self._advertise = cell, rate_hz, epoch_ns, advertise
        self._rows: dict[str, list[tuple[RosTopic, Send]]] = {}
        self._first: dict[tuple[str, str], int] = {}

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self._rows)

    def hear(self, key: str, payload: bytes, receive_ns: int) -> None:
        """Publishes the messages of a payload that are due and stores the slave's newest state; at the first
        payload of an axis advertises its topics. Ignores what can not be decoded, other topics, and every
        axis after the first 32.
        """
        parsed = parse_key(key)
        if parsed is None or parsed[2].name not in _SOURCES:
            return
        _, axis, topic = parsed
        if axis not in self._rows:
            if len(self._rows) == _MOST_AXES:
                return
            self._rows[axis] = [
                (row, self._advertise(ros_name(self._cell, axis, row.name), row.type)) for row in TABLE
            ]
        try:
            received = self._due(axis, topic, payload, receive_ns)
        except CodecError:
            return
        for message, message_ns in received:
            if isinstance(message, SlaveState):
                self.states[axis] = message, message_ns
            stamp_ns = self._epoch_ns(message_ns)
            header = cdr.RosHeader(stamp_ns, f"{self._cell}/{axis}")
            for row, send in self._rows[axis]:
                encoded = row.encode(message, header, axis) if row.source.name == topic.name else None
                if encoded is not None:
                    send(encoded, stamp_ns)

    def _due(self, axis: str, topic: Topic[Any], payload: bytes, receive_ns: int) -> list[tuple[Any, int]]:
        """Messages of a payload that are to be published, with their stamps: of a batched topic every n-th,
        counted on from batch to batch, for `rate_hz`; of another all. Raises CodecError.
        """
        step = max(1, round((topic.rate_hz or 1.0) / self._rate_hz)) if topic.batched else 1
        number, first = counted(payload), self._first.get((axis, topic.name), 0)
        self._first[axis, topic.name] = (first - number) % step
        received = observed(topic, payload, receive_ns, step=step, first=first)
        return received if (number - 1 - first) % step == 0 else received[:-1]

    def diagnostics(self, now_ns: int) -> bytes:
        """DiagnosticArray with the status of each axis that has sent a state."""
        return cdr.diagnostic_array(
            self._epoch_ns(now_ns),
            [
                _status(self._cell, axis, state, now_ns - receive_ns > _STALE_NS)
                for axis, (state, receive_ns) in sorted(self.states.copy().items())
            ],
        )


def _status(cell: str, axis: str, state: SlaveState, stale: bool) -> cdr.DiagnosticStatus:
    """Status of an axis, at the first level that holds: stale, error in FAULT and ESTOPPED, warning above the
    force limit or near a load, ok.
    """
    stopped = state.state in {SafetyState.FAULT, SafetyState.ESTOPPED}
    level = 3 if stale else 2 if stopped else int(state.over_limit or state.near_load is not None)
    values = {
        "state": state.state.value,
        "stops": str(state.stops),
        "slipped_m": f"{state.slipped_m:g}",
        "near_load": state.near_load or "",
        "caveats": "; ".join(state.caveats),
        **{name: str(number) for name, number in sorted(state.counters.items())},
    }
    return cdr.DiagnosticStatus(level, f"forefeel: {cell}/{axis}", state.reason, cell, list(values.items()))
