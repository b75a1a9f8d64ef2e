"""Attacks on real processes over real Zenoh: plain on loopback, and over mutual TLS."""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import zenoh

from forefeel.common.codec import encode
from forefeel.common.events.sink import SAFETY
from forefeel.common.messages import MotionCommand
from forefeel.common.state.folder import EVENTS
from forefeel.common.topics import (
    COMMAND,
    EMERGENCY_STOP,
    FORCE,
    LIMIT_EVENT,
    MASTER_HANDSHAKE,
    MASTER_HEARTBEAT,
    SAFETY_EVENT,
    SLAVE_STATE,
    SLAVE_TIMING,
    Topic,
)
from tests.event_lines import read_events
from tests.live_cell import AXIS, CELL, LiveCell, Process
from tests.messages import usual
from tests.simulation.attack_outcome import Expected, Outcome
from tests.system.attacks.flood import flood
from tests.system.attacks.stranger import CONNECTED, HEARING, PAPERS, Stranger, stranger, tls_of
from tests.system.rows import Result, Row
from tests.waiting import wait_until

_OURS = ("refused_", "malformed_", "handshakes_", "heartbeats_", "sessions_")
_SETTLE_S = 0.3
_FLOOD_S = 2.0
_ARMED = 0.97  # on a machine that others use a tick in thirty may be late
_GROWTH_MB = 40.0
_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e]")


class Scene:
    """A live cell that is armed, a stranger at the slave's door, and what is seen from then on."""

    def __init__(self, name: str, cell: LiveCell, attacker: Stranger) -> None:
        self.cell, self.attacker = cell, attacker
        self.outcome = Outcome(name)
        self.forged: set[tuple[int, int]] = set()
        cell.await_state("armed")
        self.from_ns = time.monotonic_ns()
        self._before = self._counters()
        self._resident_mb = self._slave().resident_mb()

    def _slave(self) -> Process:
        return next(p for p in reversed(self.cell.started) if p.role == "slave")

    def _counters(self) -> dict[str, int]:
        newest = self.cell.newest_state()
        return {} if newest is None else dict(newest[1].counters)

    def put(self, topic: Topic[Any], payload: bytes) -> None:
        self.attacker.put(topic.taken_key(CELL, AXIS), payload)

    def command(self, **changes: object) -> bytes:
        """A forged command: right session, numbered and stamped ahead, away from here."""
        newest = self.cell.newest(COMMAND)
        fields = {**newest.__dict__, "sequence": newest.sequence + 200, "stamp_ns": time.monotonic_ns()}
        forged = MotionCommand(**{**fields, "position_m": 0.1, "deadman": True, **changes})
        self.forged.add((forged.sequence, forged.stamp_ns))
        return encode(forged)

    def flood(self, topic: Topic[Any], rate_hz: float, payloads: Sequence[bytes]) -> int:
        """By a process of its own for some seconds; how many it put."""
        put = flood(self.cell.endpoint, topic.taken_key(CELL, AXIS), rate_hz, _FLOOD_S, payloads)
        self.outcome.note = f"{put / _FLOOD_S:.0f} a second,"
        return put

    def _logged(self) -> Counter[str]:
        """What the slave's event log says since the scene began: transitions, refusals, and what else."""
        noted = read_events(self.cell.folder / "state-slave" / EVENTS)
        return Counter(
            str(each.details.get("event" if each.event == SAFETY else "name", each.event))
            for each in noted
            if each.monotonic_ns >= self.from_ns
        )

    def _await_count(self, expected: Expected) -> None:
        """What was put last is read and counted within a second or two, on a machine that others use, too."""
        time.sleep(_SETTLE_S)
        deadline_s, wanted = time.monotonic() + 2.0, self._before.get(expected.counted, 0) + expected.times
        while self._counters().get(expected.counted, wanted) < wanted and time.monotonic() < deadline_s:
            time.sleep(0.05)

    def end(self, expected: Expected) -> Outcome:
        outcome, cell = self.outcome, self.cell
        self._await_count(expected)
        states = [m.state.value for m in cell.since(SLAVE_STATE, self.from_ns)]
        outcome.armed = states.count("armed") / max(len(states), 1)
        outcome.ends = states[-1] if states else "silent"
        now = self._counters()
        outcome.counters = {k: n - self._before.get(k, 0) for k, n in now.items() if k.startswith(_OURS)}
        rules = [m.rule for m in cell.since(LIMIT_EVENT, self.from_ns) if f"refused_{m.rule}" in now]
        events = [m.event for m in cell.since(SAFETY_EVENT, self.from_ns)]
        outcome.told = {name: (rules + events).count(name) for name in dict.fromkeys(rules + events)}
        outcome.logged = self._logged()
        answered = {(m.answers_sequence, m.answers_stamp_ns) for m in cell.since(FORCE, self.from_ns)}
        outcome.executed = len(self.forged & answered)
        outcome.require(self._slave().running, "the slave has ended")
        growth_mb = self._slave().resident_mb() - self._resident_mb
        outcome.require(growth_mb < _GROWTH_MB, f"the slave grew by {growth_mb:.0f} MB")
        timing = cell.since(SLAVE_TIMING, self.from_ns)
        outcome.note += f" grew {growth_mb:.1f} MB"
        if timing:
            outcome.note += f", loop p99 {timing[-1].p99_us:.0f} us since its start"
        return outcome.judge(expected)


def handshake(session_id: int, sequence: int) -> bytes:
    """With the right settings."""
    return encode(usual(MASTER_HANDSHAKE, session_id=session_id, sequence=sequence))


def wildcards(scene: Scene) -> Outcome:
    """A put to a pattern reaches whoever hears any key of it."""
    stop = encode(usual(EMERGENCY_STOP))
    keys = ("forefeel/**", "forefeel/*/*/any/estop", "forefeel/ce$*/*/any/estop", f"forefeel/{CELL}/**", "**")
    for key in keys:
        scene.attacker.put(key, stop)
    scene.attacker.put(f"forefeel/{CELL}/*/master/command", scene.command())
    return scene.end(Expected(armed=_ARMED))


def oversized(scene: Scene) -> Outcome:
    for topic in (COMMAND, MASTER_HANDSHAKE, MASTER_HEARTBEAT):
        for _ in range(10):
            scene.put(topic, bytes(100_000))
        scene.put(topic, bytes(1 << 20))
    for _ in range(2):
        scene.put(COMMAND, bytes(64 << 20))
    return scene.end(Expected("malformed_master_command", 10, armed=_ARMED))


def costly(scene: Scene) -> Outcome:
    """Arrays that claim to be long, in one another: 500 a second of the largest that is read."""
    bomb = (b"\xdd\x00\x00\x07\xff" * 409)[:2048]
    put = scene.flood(COMMAND, 500, [bomb])
    return scene.end(Expected("malformed_master_command", put, armed=_ARMED))


def flood_unpaced(scene: Scene) -> Outcome:
    """As fast as one process can put. The session may suffer; nothing forged is executed, and it recovers."""
    scene.flood(COMMAND, 1e6, [scene.command(session_id=4711)])
    scene.cell.await_state("armed", 10.0)
    return scene.end(Expected("refused_session", 5000, "session", armed=0.0))


def flood_of_handshakes(scene: Scene) -> Outcome:
    """Each with an id of its own and the right settings."""
    scene.flood(MASTER_HANDSHAKE, 10_000, [handshake(10**6 + i, i) for i in range(100)])
    return scene.end(Expected("handshakes_refused", 500, armed=_ARMED))


def flood_of_stops(scene: Scene) -> Outcome:
    """Ten thousand a second, with control characters in their reason: one stop, told once, printed clean."""
    payload = encode(usual(EMERGENCY_STOP, reason="\x1b[2J\u202estop"))
    scene.flood(EMERGENCY_STOP, 10_000, [payload])
    outcome = scene.end(Expected(told="estop", armed=0.0, ends="estopped"))
    outcome.require(outcome.told.get("estop") == 1, "told more than once")
    said = "".join(process.log.read_text(encoding="utf-8") for process in scene.cell.started)
    outcome.require("[2J" in said, "the reason was not shown")
    outcome.require(not _CONTROL.search(said), "printed as it is")
    return outcome


PLAIN: dict[str, Callable[[Scene], Outcome]] = {
    "put to a pattern of keys": wildcards,
    "payloads of 100 kB, 1 MB and 64 MB": oversized,
    "payloads that are costly to read": costly,
    "flood of commands as fast as can be": flood_unpaced,
    "flood of handshakes": flood_of_handshakes,
    "flood of emergency stops": flood_of_stops,
}


def _all_that_moves(scene: Scene, act: Stranger) -> None:
    """Commands numbered ahead, a session of his own, heartbeats, what the slave says."""
    for i in range(100):
        scene.put(COMMAND, scene.command())
        scene.put(MASTER_HANDSHAKE, handshake(4711 + i, i))
        scene.put(MASTER_HEARTBEAT, b"x")
        act.put(f"forefeel/{CELL}/**", scene.command())
        time.sleep(0.005)


def with_papers(scene: Scene, papers: str) -> Outcome:
    """What he puts must reach nobody: not even a counter of ours moves."""
    heard: list[bytes] = []
    subscriber: Any = scene.attacker.session.declare_subscriber(
        SLAVE_STATE.key(CELL, AXIS),
        lambda sample: heard.append(sample.payload.to_bytes()),
        allowed_origin=zenoh.Locality.REMOTE,
    )
    time.sleep(1.2)
    _all_that_moves(scene, scene.attacker)
    outcome = scene.end(Expected(armed=_ARMED))
    subscriber.undeclare()
    outcome.require(not any(outcome.counters.values()), "something reached the slave")
    outcome.require(scene.attacker.connected == (papers in CONNECTED), f"link {scene.attacker.connected}")
    outcome.require(bool(heard) == (papers in HEARING), f"it heard {len(heard)} states")
    outcome.note += "; dropped by access control" if papers in CONNECTED else "; no link: TLS refuses it"
    return outcome


def _plain(name: str, folder: Path) -> Result:
    with LiveCell(folder) as cell:
        cell.pair()
        with stranger(cell.endpoint) as attacker:
            wait_until(lambda: attacker.connected, 5.0, "connected")
            time.sleep(_SETTLE_S)
            return _result(PLAIN[name](Scene(name, cell, attacker)))


def _secured(papers: str, folder: Path) -> Result:
    with LiveCell(folder, pki=True) as cell:
        assert cell.pki is not None
        cell.pair()
        with stranger(cell.endpoint, tls_of(papers, cell.pki, folder)) as attacker:
            return _result(with_papers(Scene(papers, cell, attacker), papers))


def _result(outcome: Outcome) -> Result:
    return Result(str(outcome), outcome.wrong)


def rows() -> Iterator[Row]:
    for name in PLAIN:
        yield Row(f"attack: {name}", partial(_plain, name))
    for papers in PAPERS:
        yield Row(f"attack: commands of {papers}", partial(_secured, papers))
