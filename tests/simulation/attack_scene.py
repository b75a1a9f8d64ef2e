"""A cell in virtual time that is attacked: both daemons, and a stranger on the same bus."""

from collections import Counter
from typing import Any

import numpy as np

from forefeel.common.codec import decode, encode
from forefeel.common.messages import Heartbeat, MotionCommand
from forefeel.common.settings import AxisLimits
from forefeel.common.topics import (
    COMMAND,
    FORCE,
    LIMIT_EVENT,
    MASTER_HEARTBEAT,
    SAFETY_EVENT,
    SLAVE_HEARTBEAT,
    SLAVE_STATE,
    Topic,
)
from tests.messages import usual
from tests.simulation.attack_outcome import Expected, Outcome
from tests.simulation.pair import OVERSHOOT, Pair, S

MS = 1_000_000
_OURS = ("refused_", "malformed_", "handshakes_", "heartbeats_", "sessions_")
_STILL_M = 3e-6  # steps of the encoder
_RAMP_S = 0.2 / 4.0 + 0.05  # from full speed to rest, and the servo's lag


class Scene:
    """Armed when it begins. `forged`: (sequence, stamp) of each command that nobody may execute."""

    def __init__(self, slave: dict[str, Any] | None = None) -> None:
        self.pair = Pair(slave)
        self.put = self.pair.stranger().put
        self.run = self.pair.run
        self.run(1.7)
        self.begin()

    def begin(self) -> None:
        """Starts what `end` judges, anew in a session that outlived an attack."""
        assert self.state == "armed"
        self.forged: set[tuple[int, int]] = set()
        self._from_ns = self.now_ns
        self._before = self._counters()

    def restart_slave(self) -> None:
        """Ends both and starts the slave on a host whose clock begins as the first one's, but for 12 us."""
        self.pair.master.transport.close()
        self.pair.slave.transport.close()
        self.run(1.0)
        self._from_ns, self._before = self.now_ns, {}
        self.pair.start_slave(12_345 - self.now_ns)

    @property
    def now_ns(self) -> int:
        return self.pair.runtime.clock.now_ns()

    @property
    def state(self) -> str:
        return self.pair.traffic.messages(SLAVE_STATE)[-1].state.value

    @property
    def session_id(self) -> int:
        """Session that is open, as anyone reads it from the wire."""
        return self.pair.traffic.messages(SLAVE_STATE)[-1].session_id

    @property
    def sequence(self) -> int:
        """Number of the newest command on the wire."""
        return decode(MotionCommand, self.pair.traffic.encoded(COMMAND)[-1]).sequence

    def recorded(self, topic: Topic[Any]) -> list[bytes]:
        """Payloads of that topic so far."""
        return list(self.pair.traffic.encoded(topic))

    def say(self, topic: Topic[Any], **fields: Any) -> bytes:  # noqa: ANN401 - any field
        """A message of the stranger, of the session and stamped now unless `fields` say else; its bytes."""
        written = usual(topic, **{"session_id": self.session_id, "stamp_ns": self.now_ns, **fields})
        payload = encode(written)
        self.put(topic, payload)
        if isinstance(written, MotionCommand):
            self.forged.add((written.sequence, written.stamp_ns))
        return payload

    def command(self, **changes: Any) -> None:  # noqa: ANN401 - any field
        """A command of the stranger: away from here, pressed, stamped now."""
        self.say(COMMAND, **{"sequence": self.sequence + 1, "position_m": 0.1, **changes})

    def beat(self, sequence: int, **fields: Any) -> None:  # noqa: ANN401 - any field
        self.say(MASTER_HEARTBEAT, sequence=sequence, **fields)

    def echo_ns(self) -> int:
        """The slave's newest stamp, as anyone reads it from the wire."""
        return decode(Heartbeat, self.pair.traffic.encoded(SLAVE_HEARTBEAT)[-1]).stamp_ns

    def replace_master(self) -> None:
        """Silences the master as SIGKILL does, and starts another one."""
        self.pair.master.transport.close()
        self.pair.start_master()

    def clear(self) -> None:
        for axis in self.pair.slave.axes:
            axis.clear()

    def end(self, expected: Expected) -> Outcome:
        """Asserts all that was seen since the scene began."""
        now = self._counters()
        outcome = Outcome("", self._armed_share(), self.state)
        outcome.counters = {k: n - self._before.get(k, 0) for k, n in now.items() if k.startswith(_OURS)}
        outcome.told = self._told(now)
        answered = {(m.answers_sequence, m.answers_stamp_ns) for m in self.pair.traffic.messages(FORCE)}
        outcome.executed = len(self.forged & answered)
        outcome.require(self._still(), "the stage moved while nothing was followed")
        outcome.require(self._smooth(), "the stage was faster than its limit")
        assert outcome.judge(expected).wrong == []
        return outcome

    def _counters(self) -> dict[str, int]:
        self.run(0.03)
        return dict(self.pair.traffic.messages(SLAVE_STATE)[-1].counters)

    def _armed_share(self) -> float:
        states = [m.state for m in self.pair.traffic.messages(SLAVE_STATE) if m.stamp_ns > self._from_ns]
        return sum(state.value == "armed" for state in states) / max(len(states), 1)

    def _told(self, counters: dict[str, int]) -> Counter[str]:
        told: Counter[str] = Counter()
        for limit in self.pair.traffic.messages(LIMIT_EVENT):
            if limit.stamp_ns > self._from_ns and f"refused_{limit.rule}" in counters:
                told[limit.rule] += 1
        for event in self.pair.traffic.messages(SAFETY_EVENT):
            if event.stamp_ns > self._from_ns:
                told[event.event] += 1
        return told

    def _still(self) -> bool:
        """From the ramp's end to the next engagement the stage stands."""
        traffic = self.pair.traffic
        time_s, position_m = traffic.column(FORCE, "stamp_ns") / S, traffic.column(FORCE, "position_m")
        events = [*traffic.events(), (self.now_ns / S, "engage")]
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
        speed = np.abs(self.pair.traffic.column(FORCE, "velocity_m_s"))
        return float(speed.max()) <= OVERSHOOT * AxisLimits().max_velocity_m_s
