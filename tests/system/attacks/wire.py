"""Attacks on real processes over real Zenoh: plain on loopback, and over mutual TLS."""

import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import zenoh

from forefeel.common.clock import now_utc
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
from forefeel.common.transport.pki import AUTHORITY
from forefeel.common.transport.security import PartyRole
from forefeel.pki.folder import AUTHORITY_KEY
from tests.event_lines import read_events
from tests.live_cell import AXIS, CELL, ROOT, LiveCell
from tests.messages import usual
from tests.secured import connected, make_pki, sessions
from tests.simulation.attack_outcome import Expected, Outcome
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

    def __init__(self, name: str, cell: LiveCell, attacker: zenoh.Session) -> None:
        self.cell, self.attacker = cell, attacker
        self.outcome = Outcome(name)
        self.forged: set[tuple[int, int]] = set()
        self._slave = cell.started[0]
        cell.await_state("armed")
        self.from_ns = time.monotonic_ns()
        self._before = self._counters()
        self._resident_mb = self._slave.resident_mb()

    def _counters(self) -> dict[str, int]:
        newest = self.cell.newest_state()
        return {} if newest is None else dict(newest[1].counters)

    def put(self, topic: Topic[Any] | str, payload: bytes) -> None:
        """Puts it on the slave's key of a topic, or on any key."""
        key = topic if isinstance(topic, str) else topic.taken_key(CELL, AXIS)
        self.attacker.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    def command(self, **changes: object) -> bytes:
        """A forged command: right session, numbered and stamped ahead, away from here."""
        newest = self.cell.newest(COMMAND)
        fields = {**newest.__dict__, "sequence": newest.sequence + 200, "stamp_ns": time.monotonic_ns()}
        forged = MotionCommand(**{**fields, "position_m": 0.1, "deadman": True, **changes})
        self.forged.add((forged.sequence, forged.stamp_ns))
        return encode(forged)

    def flood(self, topic: Topic[Any], rate_hz: float, payloads: Sequence[bytes]) -> int:
        """Puts them by a process of its own for some seconds; how many it put."""
        key, module = topic.taken_key(CELL, AXIS), "tests.system.attacks.flood"
        command = [sys.executable, "-m", module, self.cell.endpoint, key, str(rate_hz), str(_FLOOD_S)]
        lines = "\n".join(payload.hex() for payload in payloads)
        done = subprocess.run(
            command, input=lines, capture_output=True, text=True, cwd=ROOT, timeout=_FLOOD_S + 60, check=True
        )
        self.outcome.note = f"{int(done.stdout) / _FLOOD_S:.0f} a second,"
        return int(done.stdout)

    def _await_count(self, expected: Expected) -> None:
        """What was put last is read and counted within a second or two, on a machine that others use, too."""
        time.sleep(_SETTLE_S)
        wanted = self._before.get(expected.counted, 0) + expected.times
        with suppress(AssertionError):
            wait_until(lambda: self._counters().get(expected.counted, wanted) >= wanted, 2.0, every_s=0.05)

    def end(self, expected: Expected) -> Outcome:
        outcome, cell, from_ns = self.outcome, self.cell, self.from_ns
        self._await_count(expected)
        states = [m.state.value for m in cell.since(SLAVE_STATE, from_ns)]
        outcome.armed = states.count("armed") / max(len(states), 1)
        outcome.ends = states[-1] if states else "silent"
        now = self._counters()
        outcome.counters = {k: n - self._before.get(k, 0) for k, n in now.items() if k.startswith(_OURS)}
        outcome.told = Counter(m.rule for m in cell.since(LIMIT_EVENT, from_ns) if f"refused_{m.rule}" in now)
        outcome.told += Counter(m.event for m in cell.since(SAFETY_EVENT, from_ns))
        outcome.logged = Counter(
            str(entry.details.get("event" if entry.event == SAFETY else "name", entry.event))
            for entry in read_events(cell.folder / "state-slave" / EVENTS)
            if entry.monotonic_ns >= from_ns
        )
        answered = {(m.answers_sequence, m.answers_stamp_ns) for m in cell.since(FORCE, from_ns)}
        outcome.executed = len(self.forged & answered)
        outcome.require(self._slave.running, "the slave has ended")
        growth_mb = self._slave.resident_mb() - self._resident_mb
        outcome.require(growth_mb < _GROWTH_MB, f"the slave grew by {growth_mb:.0f} MB")
        outcome.note += f" grew {growth_mb:.1f} MB"
        if timing := cell.since(SLAVE_TIMING, from_ns):
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
        scene.put(key, stop)
    scene.put(f"forefeel/{CELL}/*/master/command", scene.command())
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


PAPERS: dict[str, tuple[PartyRole, bool, bool]] = {
    "no certificate": ("master", False, False),
    "a certificate of another authority": ("master", False, False),
    "an expired certificate": ("master", False, False),
    "another cell's master": ("master", True, False),
    "viewer": ("viewer", True, True),
    "recorder": ("recorder", True, True),
}
"""Role, whether it is connected, and whether it hears the slave's states. What is connected has a certificate
of the right authority: access control is what keeps it out.
"""


def certificates_of(papers: str, pki: Path, folder: Path) -> Path:
    """The folder of somebody with such papers, signed by the right authority unless they are of another."""
    own = folder / "own"
    own.mkdir()
    if papers != "a certificate of another authority":
        for name in (AUTHORITY, AUTHORITY_KEY):
            shutil.copy2(pki / name, own)
    signed = now_utc() - timedelta(days=40 if papers == "an expired certificate" else 0)
    return make_pki(own, ["other" if papers == "another cell's master" else CELL], now=signed, days=30)


def with_papers(scene: Scene) -> Outcome:
    """Commands numbered ahead, a session of his own, heartbeats, what the slave says: all that moves must
    reach nobody. Not even a counter of ours moves.
    """
    (_, connects, hears), heard = PAPERS[scene.outcome.attack], list[bytes]()
    subscriber: Any = scene.attacker.declare_subscriber(
        SLAVE_STATE.key(CELL, AXIS),
        lambda sample: heard.append(sample.payload.to_bytes()),
        allowed_origin=zenoh.Locality.REMOTE,
    )
    time.sleep(1.2)
    for i in range(100):
        scene.put(COMMAND, scene.command())
        scene.put(MASTER_HANDSHAKE, handshake(4711 + i, i))
        scene.put(MASTER_HEARTBEAT, b"x")
        scene.put(f"forefeel/{CELL}/**", scene.command())
        time.sleep(0.005)
    outcome, link = scene.end(Expected(armed=_ARMED)), connected(scene.attacker)
    subscriber.undeclare()
    outcome.require(not any(outcome.counters.values()), "something reached the slave")
    outcome.require(link == connects, f"link {link}")
    outcome.require(bool(heard) == hears, f"it heard {len(heard)} states")
    outcome.note += "; dropped by access control" if connects else "; no link: TLS refuses it"
    return outcome


def _attacked(name: str, attack: Callable[[Scene], Outcome], folder: Path) -> Result:
    with LiveCell(folder, pki=name in PAPERS) as cell, sessions() as network:
        cell.pair()
        if cell.pki is not None:
            certificates = None if name == "no certificate" else certificates_of(name, cell.pki, folder)
            attacker = network.attacker(cell.endpoint, certificates, PAPERS[name][0], cell.pki / AUTHORITY)
        else:
            attacker = network.attacker(cell.endpoint)
            wait_until(lambda: connected(attacker), 5.0, "connected")
            time.sleep(_SETTLE_S)
        outcome = attack(Scene(name, cell, attacker))
    return Result(str(outcome), outcome.wrong)


def rows() -> Iterator[Row]:
    for name, attack in PLAIN.items():
        yield Row(f"attack: {name}", partial(_attacked, name, attack))
    for papers in PAPERS:
        yield Row(f"attack: commands of {papers}", partial(_attacked, papers, with_papers))
