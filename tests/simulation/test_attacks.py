"""Attacks where the transport does not matter: in virtual time, both daemons and a stranger on the bus.

Those on real processes are in tests.system.
"""

from collections.abc import Callable, Iterator
from functools import partial
from random import Random

import msgpack
import pytest

from forefeel.common.messages import PROTOCOL_VERSION
from forefeel.common.topics import (
    COMMAND,
    EMERGENCY_STOP,
    MASTER_HANDSHAKE,
    MASTER_HEARTBEAT,
    MASTER_STATE,
    SLAVE_HANDSHAKE,
)
from tests.simulation.attack_outcome import Expected, Outcome
from tests.simulation.attack_scene import MS, Scene
from tests.simulation.pair import Pair, S

_REARMED_S = 4.5  # the lease of 1 s, a new session, the clocks, the operator's hand


def replayed_commands(name: str) -> Outcome:
    scene = Scene(name)
    for payload in scene.recorded(COMMAND)[-500:]:
        scene.put(COMMAND, payload)
    scene.run(0.5)
    return scene.end(Expected("refused_sequence", 500, "sequence"))


def replayed_after_the_session(name: str) -> Outcome:
    """The master dies, another one takes over; what the first recorded comes again."""
    scene = Scene(name)
    old = scene.recorded(COMMAND)[-500:]
    scene.kill_master()
    scene.pair.start_master()
    scene.run(2.6)
    for payload in old:
        scene.put(COMMAND, payload)
    scene.run(0.3)
    return scene.end(Expected("refused_session", 500, "session", armed=0.1))


def replayed_to_a_new_slave(name: str) -> Outcome:
    """All that the master recorded, with its timing, to a slave that was started again and whose clock begins
    where it began then, but for 12 microseconds: the whole session is done again.
    """
    scene = Scene(name)
    start_s = 0.0
    recorded = [
        (stamp_ns, topic, payload)
        for topic in (MASTER_HANDSHAKE, MASTER_HEARTBEAT, COMMAND)
        for key, payload, stamp_ns in scene.pair.traffic.payloads
        if key == topic.key("cell", "insertion") and stamp_ns >= start_s * S
    ]
    scene.pair.master.transport.close()
    scene.pair.slave.transport.close()
    scene.run(1.0)
    began_ns = scene.now_ns
    scene._from_ns, scene._before = began_ns, {}
    scene.pair.start_slave(12_345 - began_ns)
    for stamp_ns, topic, payload in sorted(recorded, key=lambda entry: entry[0]):
        while scene.now_ns - began_ns < stamp_ns:
            scene.run(0.001)
        scene.put(topic, payload)
    events = {event for time_s, event in scene.pair.traffic.events()[3:]}
    outcome = scene.end(Expected("heartbeats_refused", 5, armed=0.0, ends="idle"))
    outcome.require(not events & {"engage", "engaged"}, f"events {events}")
    return outcome


def future_stamped(name: str) -> Outcome:
    scene = Scene(name)
    for ahead in (0.1, 1, 3600, 1e9):
        for i in range(10):
            scene.command(sequence=10**6 + i, stamp_ns=scene.now_ns + round(ahead * S))
        scene.run(0.05)
    return scene.end(Expected("refused_future", 40, "future"))


def reordered(name: str) -> Outcome:
    """A network that holds one command in twenty back, so that those after it come first."""
    link = {"reorder": 0.05, "reorder_hold_s": 0.02}
    scene = Scene(name, {"impairment": {"inbound": link}})
    scene.run(1.0)
    return scene.end(Expected())


def reordered_by_a_stranger(name: str) -> Outcome:
    scene = Scene(name)
    random = Random(1)

    def again() -> None:
        scene.put(COMMAND, random.choice(scene.recorded(COMMAND)[-40:-2]))

    scene.each_ms(0.3, again)
    return scene.end(Expected("refused_sequence", 300, "sequence"))


def stop_twice(name: str) -> Outcome:
    """The same bytes again, also after they were cleared: every one is a stop."""
    scene = Scene(name)
    payload = scene.say(EMERGENCY_STOP, sequence=7)
    scene.put(EMERGENCY_STOP, payload)
    scene.run(0.3)
    scene.clear()
    scene.run(2.0)
    rearmed = scene.state
    scene.put(EMERGENCY_STOP, payload)
    scene.run(0.3)
    outcome = scene.end(Expected(told="estop", armed=0.1, ends="estopped"))
    outcome.require(rearmed == "armed", f"{rearmed} after the clearing")
    outcome.require(outcome.told.get("estop") == 2, "not stopped twice")
    return outcome


def motion_while_stopped(name: str) -> Outcome:
    """Every other path: commands, a release and a press, the session again, another session, a new master,
    heartbeats, garbled and fine words about clearing.
    """
    scene = Scene(name)
    scene.say(EMERGENCY_STOP)
    scene.run(0.3)
    stood_m = scene.pair.slave.axes[0]._watch.stage.position_m
    for deadman in (True, False, True):
        scene.command(position_m=stood_m + 0.0005, deadman=deadman, sequence=scene.sequence + 1)
        scene.run(0.05)
    scene.say(MASTER_HANDSHAKE)
    scene.say(MASTER_HANDSHAKE, session_id=0)
    scene.say(MASTER_HANDSHAKE, session_id=4711)
    scene.put(EMERGENCY_STOP, b"clear")
    scene.run(0.5)
    scene.kill_master()
    scene.pair.start_master()
    scene.run(2.0)
    moved_m = abs(scene.pair.slave.axes[0]._watch.stage.position_m - stood_m)
    outcome = scene.end(Expected("handshakes_refused", 1, "estop", armed=0.0, ends="estopped"))
    outcome.require(moved_m < 3e-6, f"moved by {moved_m * 1e6:.0f} um")
    return outcome


def flood_of_handshakes(name: str) -> Outcome:
    """Ten thousand a second; meanwhile a new master comes in the place of a dead one."""
    scene = Scene(name)
    ids = iter(range(10**6, 10**9))
    other = {"settings_hash": "other", "settings": '{"cell": "x"}'}
    first = msgpack.unpackb(scene.say(MASTER_HANDSHAKE, session_id=next(ids), **other))

    def shakes() -> None:
        for _ in range(10):
            scene.put(
                MASTER_HANDSHAKE, msgpack.packb({**first, "session_id": next(ids), "stamp_ns": scene.now_ns})
            )

    scene.each_ms(0.5, shakes)
    kept = scene.state
    scene.kill_master()
    scene.pair.start_master()
    scene.each_ms(2.8, shakes)
    outcome = scene.end(Expected("handshakes_refused", 1000, armed=0.1))
    outcome.require(kept == "armed", "the session did not outlive the first half second")
    return outcome


def malformed(name: str) -> Outcome:
    """Payloads that are no command or nearly one."""
    scene = Scene(name)
    payloads = list(garbage(scene.recorded(COMMAND)[-1]))
    for payload in payloads:
        for topic in (COMMAND, MASTER_HANDSHAKE, MASTER_HEARTBEAT):
            scene.put(topic, payload)
        scene.run(0.002)
    return scene.end(Expected("malformed_master_command", len(payloads)))


def garbled_stop(name: str) -> Outcome:
    """Garbage on the emergency stop is a stop."""
    scene = Scene(name)
    scene.put(EMERGENCY_STOP, bytes(65_537))
    scene.run(0.2)
    return scene.end(Expected("malformed_any_estop", 1, "estop", armed=0.0, ends="estopped"))


def garbage(whole: bytes) -> Iterator[bytes]:
    """Payloads that are no command: random, cut, deep, huge, of wrong types; from a good one."""
    random = Random(3)
    good = msgpack.unpackb(whole)
    yield from (random.randbytes(random.randrange(1, 300)) for _ in range(50))
    yield from (whole[:n] for n in range(1, len(whole), 7))
    yield from (whole + b"\xc0", b"", bytes(65_537), bytes(2049))
    yield b"\xdd\x00\x00\xff\xf0" * 1000  # arrays in arrays that claim to be long
    yield b"\x91" * 2000  # nested deeper than anything
    yield b"\xdf\xff\xff\xff\xff"  # a map of four thousand million
    yield b"\xc6\xff\xff\xff\xff"  # as many bytes
    for field, value in (
        ("position_m", float("nan")), ("velocity_m_s", float("inf")), ("position_m", "0.1"), ("deadman", 1),
        ("sequence", 1.5), ("sequence", -1), ("sequence", 2**64 - 1), ("stamp_ns", None), ("gripper", "ajar"),
        ("unknown", 1), ("recording_time_s", float("-inf")), ("protocol", PROTOCOL_VERSION + 1),
        ("deadman", b"\xff\xfe"), ("position_m", 1e300),
    ):  # fmt: skip
        yield msgpack.packb({**good, field: value})
    yield whole.replace(b"position_m", b"positi\xff\xfem")


def terminal_escapes(name: str) -> Outcome:
    """Control characters in all that is shown to a person, at the slave and at the master."""
    scene = Scene(name)
    evil = "\x1b]0;owned\x07\x1b[2J\r\n\u202ecba"
    scene.say(MASTER_HANDSHAKE, session_id=4711, settings=evil, settings_hash=evil, software=evil)
    scene.run(0.1)
    scene.kill_master()
    scene.pair.start_master()
    scene.run(0.06)
    scene.say(
        SLAVE_HANDSHAKE, session_id=scene.pair.master.axes[0].session.session_id, reason=evil,
        answers_stamp_ns=scene.now_ns,
    )  # fmt: skip
    scene.run(0.15)
    shown = [scene.pair.master.axes[0].session.cause(scene.now_ns)]
    scene.say(EMERGENCY_STOP, reason=evil)
    scene.run(0.2)
    shown += (
        scene.pair.slave.axes[0].events.notices.drain() + scene.pair.master.axes[0].events.notices.drain()
    )
    shown += [scene.pair.traffic.messages(MASTER_STATE)[-1].reason]
    outcome = scene.end(Expected("handshakes_refused", 1, "estop", armed=0.0, ends="estopped"))
    outcome.require(any("owned" in text for text in shown), "the text was not shown at all")
    outcome.require(all(text.isprintable() for text in shown), f"shown as it is: {shown}")
    return outcome


def names(name: str) -> Outcome:
    """A cell or axis that would be a pattern: refused when the settings are read."""
    outcome = Outcome(name, 1.0, "armed")
    for bad in ("*", "**", "$*", "a*", "a/b", "a?x", "a#b", "", " ", "@x", "a b", "\n"):
        for settings in ({"cell": bad}, {"axes": [{"name": bad}]}):
            try:
                Pair(settings)
            except Exception as error:  # noqa: BLE001 - which it is is judged
                one_line = "\n" not in str(error) and type(error).__name__ == "ConfigurationError"
                outcome.require(one_line, f"{bad!r}: {error!r}")
            else:
                outcome.require(False, f"{settings} accepted")
    return outcome


def second_master(name: str) -> Outcome:
    scene = Scene(name)
    scene.pair.start_master()
    scene.run(2.0)
    return scene.end(Expected("handshakes_refused", 4))


def second_writer(name: str) -> Outcome:
    """Fresh commands with the session's id, numbered from 1: all of these numbers were used."""
    scene = Scene(name)
    for i in range(100):
        scene.command(sequence=1 + i, stamp_ns=scene.now_ns + 1)
        scene.run(0.001)
    return scene.end(Expected("refused_sequence", 100, "sequence"))


def hijacker(ahead: int, name: str) -> Outcome:
    """Fresh commands with the session's id, numbered ahead of the master's: who is the writer?

    Nobody can say without certificates, so the session ends. Those of the first tick or two are followed.
    """
    scene = Scene(name)
    session_id, first = scene.session_id, scene.sequence + ahead
    here_m = scene.pair.slave.axes[0]._watch.stage.position_m
    for i in range(100):
        scene.command(session_id=session_id, sequence=first + i, position_m=here_m + 0.04)
        scene.run(0.001)
    scene.run(_REARMED_S)
    scene.forged = set(sorted(scene.forged)[2:])
    return scene.end(Expected("refused_second_writer", 1, "session_lost", armed=0.2))


def replayed_heartbeats(name: str) -> Outcome:
    """The master is dead; its heartbeats come again and again, and nobody else may have the lease."""
    scene = Scene(name)
    recorded = scene.recorded(MASTER_HEARTBEAT)[-20:]
    scene.kill_master()
    scene.pair.start_master()
    for i in range(40):
        scene.put(MASTER_HEARTBEAT, recorded[i % 20])
        scene.run(0.05)
    scene.run(1.0)
    return scene.end(Expected("heartbeats_refused", 15, "watchdog", armed=0.1))


def forged_heartbeats(name: str) -> Outcome:
    """Right numbers and echoes, as of one who reads along; they keep a session without commands for 3 s."""
    scene = Scene(name)
    dead = scene.session_id
    scene.kill_master()
    scene.pair.start_master()
    for i in range(110):
        echo_ns = scene.echo_ns()
        scene.beat(10_000 + i, session_id=dead, echo_stamp_ns=echo_ns, echo_receive_ns=echo_ns)
        scene.run(0.05)
    return scene.end(Expected("sessions_released", 1, "session_lost", armed=0.05))


def invented_echoes(name: str) -> Outcome:
    """Heartbeats that answer what the slave never sent: a round trip of nothing, a clock a minute off."""
    scene = Scene(name)
    clock = scene.pair.slave.axes[0]._session.offset
    for i in range(40):
        now_ns = scene.now_ns
        lie = {"echo_stamp_ns": now_ns + 9 * MS, "echo_receive_ns": now_ns + 60 * S}
        scene.beat(10_000 + i, stamp_ns=now_ns + 60 * S, **lie)
        scene.run(0.025)
    outcome = scene.end(Expected("heartbeats_refused", 40))
    after = scene.pair.slave.axes[0]._session.offset
    outcome.require(clock is not None and after is not None, "no clock")
    if clock is not None and after is not None:
        moved_ns = abs(after.offset_ns - clock.offset_ns)
        outcome.require(moved_ns < 2 * MS, f"the offset moved by {moved_ns} ns")
    return outcome


def lying_clock(shift_s: float, name: str) -> Outcome:
    """Right echoes, as of one who reads along, but a clock that is off; then a burst of old commands.

    It makes no old command new, and stops nothing: a stamp that is off moves nothing.
    """
    scene = Scene(name)
    session_id = scene.session_id
    for i in range(20):
        echo_ns = scene.echo_ns()
        lie_ns = scene.now_ns + round(shift_s * S)
        got_ns = lie_ns - (scene.now_ns - echo_ns)  # so that the round trip is the shortest that can be
        scene.beat(10_000 + i, stamp_ns=lie_ns, echo_stamp_ns=echo_ns, echo_receive_ns=got_ns)
        scene.run(0.05)
    old_ns = scene.now_ns - 2 * S
    first = scene.sequence + 50
    for i in range(200):
        scene.command(session_id=session_id, sequence=first + i, stamp_ns=old_ns + i * MS)
    scene.run(2.0)  # a session that were lost would be so after the lease of 1 s
    outcome = scene.end(Expected("refused_late", 200))
    outcome.require(outcome.counters["heartbeats_refused"] >= 20, f"{outcome}")
    return outcome


VIRTUAL: dict[str, Callable[[str], Outcome]] = {
    "commands replayed within the session": replayed_commands,
    "commands replayed after the session": replayed_after_the_session,
    "a whole session replayed to a slave started again": replayed_to_a_new_slave,
    "commands stamped in the future": future_stamped,
    "commands reordered by the network": reordered,
    "older commands put between newer ones": reordered_by_a_stranger,
    "second master, a session of its own": second_master,
    "second writer, the session's id, numbered from 1": second_writer,
    "second writer, the session's id, numbered ahead": partial(hijacker, 1000),
    "heartbeats of a dead session replayed": replayed_heartbeats,
    "heartbeats of a dead session forged": forged_heartbeats,
    "heartbeats that echo what was never sent": invented_echoes,
    "heartbeats of a clock 10 s ahead, then old commands": partial(lying_clock, 10.0),
    "heartbeats of a clock 10 s behind, then old commands": partial(lying_clock, -10.0),
    "emergency stop sent again, also after a clearing": stop_twice,
    "motion by every other path while stopped": motion_while_stopped,
    "flood of handshakes while a new master comes": flood_of_handshakes,
    "malformed payloads": malformed,
    "emergency stop that can not be read": garbled_stop,
    "control characters in texts": terminal_escapes,
    "wildcard as a name of a cell or axis": names,
}


@pytest.mark.parametrize("name", VIRTUAL)
def test_attack_is_refused_and_counted(name: str) -> None:
    assert VIRTUAL[name](name).wrong == []
