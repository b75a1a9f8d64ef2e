"""A cell in virtual time that is attacked: both daemons, and a stranger on the same bus."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from forefeel.common.codec import decode, encode
from forefeel.common.messages import EmergencyStop, Handshake, Heartbeat, Message, MotionCommand
from forefeel.common.settings import AxisLimits, settings_hash, shared_text
from forefeel.common.topics import (
    COMMAND,
    EMERGENCY_STOP,
    FORCE,
    LIMIT_EVENT,
    MASTER_HANDSHAKE,
    MASTER_HEARTBEAT,
    SAFETY_EVENT,
    SLAVE_HEARTBEAT,
    SLAVE_STATE,
    Qos,
    Topic,
)
from tests.simulation.attack_outcome import Expected, Outcome
from tests.simulation.pair import AXIS, OVERSHOOT, Pair, S

MS = 1_000_000
_OURS = ("refused_", "malformed_", "handshakes_", "heartbeats_", "sessions_")
_STILL_M = 3e-6  # steps of the encoder
_RAMP_S = 0.2 / 4.0 + 0.05  # from full speed to rest, and the servo's lag
SHARED = shared_text("cell", AXIS, AxisLimits())


class Scene:
    """Armed when it begins. `forged`: (sequence, stamp) of each command that nobody may execute."""

    def __init__(self, name: str, slave: dict[str, Any] | None = None) -> None:
        self.name = name
        self.pair = Pair(slave)
        self.stranger = self.pair.stranger()
        self._puts: dict[str, Callable[[bytes], None]] = {}
        self.forged: set[tuple[int, int]] = set()
        self.pair.run(1.7)
        assert self.state == "armed"
        self._from_ns = self.now_ns
        self._before = self._counters()

    @property
    def now_ns(self) -> int:
        return self.pair.runtime.clock.now_ns()

    @property
    def state(self) -> str:
        return self.pair.heard.messages(SLAVE_STATE)[-1].state.value

    @property
    def session_id(self) -> int:
        """As anyone reads it from the wire."""
        return self.pair.heard.messages(SLAVE_STATE)[-1].session_id

    @property
    def sequence(self) -> int:
        """Of the newest command on the wire."""
        return decode(MotionCommand, self.recorded(COMMAND)[-1]).sequence

    def recorded(self, topic: Topic[Any]) -> list[bytes]:
        """What was on the wire of that topic, as bytes."""
        return [payload for key, payload, _ in self.pair.payloads if key == topic.key("cell", AXIS)]

    def put(self, topic: Topic[Any], payload: bytes) -> None:
        """Bytes of the stranger."""
        if topic.name not in self._puts:
            self._puts[topic.name] = self.stranger.publisher(topic.taken_key("cell", AXIS), Qos.STREAM)
        self._puts[topic.name](payload)

    def say(self, topic: Topic[Any], message: Message) -> None:
        self.put(topic, encode(message))
        if isinstance(message, MotionCommand):
            self.forged.add((message.sequence, message.stamp_ns))

    def command(self, **changes: Any) -> None:  # noqa: ANN401 - any field
        """A command of the stranger: away from here, pressed, stamped now."""
        fields: dict[str, Any] = {
            "session_id": self.session_id, "sequence": self.sequence + 1, "stamp_ns": self.now_ns,
            "position_m": 0.1, "velocity_m_s": 0.0, "deadman": True,
        }  # fmt: skip
        self.say(COMMAND, MotionCommand(**{**fields, **changes}))

    def shake(self, session_id: int, **changes: Any) -> None:  # noqa: ANN401
        fields: dict[str, Any] = {
            "session_id": session_id, "sequence": 1, "stamp_ns": self.now_ns, "role": "master",
            "instance_id": 66, "software": "forefeel", "settings": SHARED,
            "settings_hash": settings_hash(SHARED),
        }  # fmt: skip
        self.say(MASTER_HANDSHAKE, Handshake(**{**fields, **changes}))

    def beat(self, sequence: int, **changes: Any) -> None:  # noqa: ANN401
        fields: dict[str, Any] = {"session_id": self.session_id, "stamp_ns": self.now_ns, **changes}
        self.say(MASTER_HEARTBEAT, Heartbeat(sequence=sequence, **fields))

    def echo_ns(self) -> int:
        """The slave's newest stamp, as anyone reads it from the wire."""
        return decode(Heartbeat, self.recorded(SLAVE_HEARTBEAT)[-1]).stamp_ns

    def stop(self, sequence: int = 1, reason: str = "stop") -> bytes:
        """An emergency stop; its bytes."""
        stop = EmergencyStop(session_id=0, sequence=sequence, stamp_ns=self.now_ns, source="x", reason=reason)
        self.say(EMERGENCY_STOP, stop)
        return encode(stop)

    def each_ms(self, duration_s: float, act: Callable[[], None]) -> None:
        """Does it once a millisecond."""
        for _ in range(round(duration_s * 1000)):
            act()
            self.run(0.001)

    def run(self, duration_s: float) -> None:
        self.pair.run(duration_s)

    def kill_master(self) -> None:
        """As SIGKILL does: it says nothing more."""
        self.pair.master.transport.close()

    def clear(self) -> None:
        for axis in self.pair.slave.axes:
            axis.clear()

    def end(self, expected: Expected) -> Outcome:
        """Judges all that was seen since the scene began."""
        now = self._counters()
        outcome = Outcome(self.name, self._armed_share(), self.state)
        outcome.counters = {k: n - self._before.get(k, 0) for k, n in now.items() if k.startswith(_OURS)}
        outcome.told = self._told(now)
        answered = {(m.answers_sequence, m.answers_stamp_ns) for m in self.pair.heard.messages(FORCE)}
        outcome.executed = len(self.forged & answered)
        outcome.require(self._still(), "the stage moved while nothing was followed")
        outcome.require(self._smooth(), "the stage was faster than its limit")
        outcome.judge(expected)
        return outcome

    def _counters(self) -> dict[str, int]:
        self.run(0.03)
        return dict(self.pair.heard.messages(SLAVE_STATE)[-1].counters)

    def _armed_share(self) -> float:
        states = [m.state for m in self.pair.heard.messages(SLAVE_STATE) if m.stamp_ns > self._from_ns]
        return sum(state.value == "armed" for state in states) / max(len(states), 1)

    def _told(self, counters: dict[str, int]) -> Counter[str]:
        told: Counter[str] = Counter()
        for limit in self.pair.heard.messages(LIMIT_EVENT):
            if limit.stamp_ns > self._from_ns and f"refused_{limit.rule}" in counters:
                told[limit.rule] += 1
        for event in self.pair.heard.messages(SAFETY_EVENT):
            if event.stamp_ns > self._from_ns:
                told[event.event] += 1
        return told

    def _still(self) -> bool:
        """From the ramp's end to the next engagement the stage stands."""
        force = self.pair.heard
        time_s, position_m = force.column(FORCE, "stamp_ns") / S, force.column(FORCE, "position_m")
        events = [*force.events(), (self.now_ns / S, "engage")]
        stops = {"release", "watchdog", "session_lost", "estop", "fault", "misaligned", "round_trip"}
        following, since_s, still = False, 0.0, True
        for at_s, event in events:
            if event == "engage" and not following:
                span = position_m[(time_s > since_s + _RAMP_S) & (time_s < at_s)]
                still &= len(span) == 0 or float(np.ptp(span)) <= _STILL_M
                following = True
            elif event in stops and following:
                following, since_s = False, at_s
        return still

    def _smooth(self) -> bool:
        speed = np.abs(self.pair.heard.column(FORCE, "velocity_m_s"))
        return float(speed.max()) <= OVERSHOOT * AxisLimits().max_velocity_m_s
