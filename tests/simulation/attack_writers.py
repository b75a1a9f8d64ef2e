"""Attacks of a second writer: sessions, heartbeats and clocks of its own, in virtual time."""

from forefeel.common.topics import MASTER_HEARTBEAT
from tests.simulation.attack_outcome import Expected, Outcome
from tests.simulation.attack_scene import MS, Scene
from tests.simulation.pair import S

_REARMED_S = 4.5


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
    """Of who reads along: right numbers, right echoes. They keep a session without commands for 3 s."""
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
    """Of who reads along: right echoes, but a clock that is off. A burst of old commands comes after it.

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
    scene.run(_REARMED_S)
    outcome = scene.end(Expected("refused_late", 200))
    outcome.require(outcome.counters["heartbeats_refused"] >= 20, f"{outcome}")
    return outcome
