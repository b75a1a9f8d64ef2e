"""Attacks where the transport does not matter: in virtual time, both daemons and a stranger on the bus.

Those on real processes are in tests.system.
"""

from collections.abc import Iterator
from random import Random
from typing import Any

import msgpack
import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.common.messages import PROTOCOL_VERSION
from forefeel.common.topics import (
    COMMAND,
    EMERGENCY_STOP,
    MASTER_HANDSHAKE,
    MASTER_HEARTBEAT,
    MASTER_STATE,
    SLAVE_HANDSHAKE,
)
from tests.simulation.attack_outcome import Expected
from tests.simulation.attack_scene import MS, Scene
from tests.simulation.pair import Pair, S

_REARMED_S = 4.5  # the lease of 1 s, a new session, the clocks, the operator's hand


@pytest.fixture(scope="module")
def session() -> Scene:
    return Scene()


@pytest.fixture
def lasting(session: Scene) -> Scene:
    """The session that every attack of these tests has to leave armed."""
    session.begin()
    return session


@pytest.fixture
def scene() -> Scene:
    """A session of the test's own."""
    return Scene()


def test_commands_replayed_within_the_session_are_refused(lasting: Scene) -> None:
    for payload in lasting.recorded(COMMAND)[-500:]:
        lasting.put(COMMAND, payload)
    lasting.run(0.3)
    lasting.end(Expected("refused_sequence", 500, "sequence"))


def test_commands_replayed_after_the_session_are_refused(scene: Scene) -> None:
    old = scene.recorded(COMMAND)[-500:]
    scene.replace_master()
    scene.run(2.6)
    for payload in old:
        scene.put(COMMAND, payload)
    scene.run(0.3)
    scene.end(Expected("refused_session", 500, "session", armed=0.1))


def test_a_whole_session_replayed_to_a_slave_started_again_opens_none(scene: Scene) -> None:
    """All that the master recorded, with its timing, to a clock that begins where it began then."""
    recorded = [
        (stamp_ns, topic, payload)
        for topic in (MASTER_HANDSHAKE, MASTER_HEARTBEAT, COMMAND)
        for key, payload, stamp_ns in scene.pair.traffic.payloads
        if key == topic.key("cell", "insertion")
    ]
    scene.restart_slave()
    began_ns = scene.now_ns
    for stamp_ns, topic, payload in sorted(recorded, key=lambda entry: entry[0]):
        while scene.now_ns - began_ns < stamp_ns:
            scene.run(0.001)
        scene.put(topic, payload)
    scene.end(Expected("heartbeats_refused", 5, armed=0.0, ends="idle"))
    assert not {"engage", "engaged"} & {event for _, event in scene.pair.traffic.events()[3:]}


def test_commands_stamped_in_the_future_are_refused(lasting: Scene) -> None:
    for ahead in (0.1, 1, 3600, 1e9):
        for i in range(10):
            lasting.command(sequence=10**6 + i, stamp_ns=lasting.now_ns + round(ahead * S))
        lasting.run(0.05)
    lasting.end(Expected("refused_future", 40, "future"))


def test_commands_that_the_network_reorders_are_followed() -> None:
    """One in twenty is held back, so that those after it come first."""
    scene = Scene({"impairment": {"inbound": {"reorder": 0.05, "reorder_hold_s": 0.02}}})
    scene.run(1.0)
    scene.end(Expected())


def test_older_commands_put_between_newer_ones_are_refused(lasting: Scene) -> None:
    random = Random(1)
    for _ in range(300):
        lasting.put(COMMAND, random.choice(lasting.recorded(COMMAND)[-40:-2]))
        lasting.run(0.001)
    lasting.end(Expected("refused_sequence", 300, "sequence"))


def test_the_same_bytes_of_a_stop_are_a_stop_again_after_a_clearing(scene: Scene) -> None:
    payload = scene.say(EMERGENCY_STOP, sequence=7)
    scene.put(EMERGENCY_STOP, payload)
    scene.run(0.3)
    for axis in scene.pair.slave.axes:
        axis.clear()
    scene.run(2.0)
    assert scene.state == "armed"
    scene.put(EMERGENCY_STOP, payload)
    scene.run(0.3)
    assert scene.end(Expected(told="estop", armed=0.1, ends="estopped")).told["estop"] == 2


def test_a_stop_that_can_not_be_read_is_one_and_by_no_other_path_is_there_motion(scene: Scene) -> None:
    """Commands, release and press, the session again, another, a word about clearing, a new master."""
    scene.put(EMERGENCY_STOP, bytes(65_537))
    scene.run(0.3)
    stood_m = scene.pair.slave.axes[0]._watch.stage.position_m
    for deadman in (True, False, True):
        scene.command(position_m=stood_m + 0.0005, deadman=deadman)
        scene.run(0.05)
    scene.say(MASTER_HANDSHAKE)
    scene.say(MASTER_HANDSHAKE, session_id=0)
    scene.say(MASTER_HANDSHAKE, session_id=4711)
    scene.put(EMERGENCY_STOP, b"clear")
    scene.run(0.3)
    scene.replace_master()
    scene.run(2.0)
    outcome = scene.end(Expected("handshakes_refused", 1, "estop", armed=0.0, ends="estopped"))
    assert outcome.counters["malformed_any_estop"] == 2
    assert scene.pair.slave.axes[0]._watch.stage.position_m == pytest.approx(stood_m, abs=3e-6)


def test_a_flood_of_handshakes_keeps_no_session_from_living_nor_a_new_master_from_coming(
    scene: Scene,
) -> None:
    """Ten thousand a second."""
    other = {"settings_hash": "other", "settings": '{"cell": "x"}'}
    first = msgpack.unpackb(scene.say(MASTER_HANDSHAKE, session_id=10**6, **other))

    def flooded(ticks: int) -> None:
        for _ in range(ticks):
            for _ in range(10):
                first.update(session_id=first["session_id"] + 1, stamp_ns=scene.now_ns)
                scene.put(MASTER_HANDSHAKE, msgpack.packb(first))
            scene.run(0.001)

    flooded(300)
    assert scene.state == "armed"
    scene.replace_master()
    flooded(2800)
    scene.end(Expected("handshakes_refused", 1000, armed=0.1))


def test_payloads_that_are_no_command_or_nearly_one_are_counted(lasting: Scene) -> None:
    payloads = list(garbage(lasting.recorded(COMMAND)[-1]))
    for payload in payloads:
        for topic in (COMMAND, MASTER_HANDSHAKE, MASTER_HEARTBEAT):
            lasting.put(topic, payload)
        lasting.run(0.002)
    lasting.end(Expected("malformed_master_command", len(payloads)))


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


def test_control_characters_are_never_shown_as_they_are(scene: Scene) -> None:
    """In all that is shown to a person, at the slave and at the master."""
    evil = "\x1b]0;owned\x07\x1b[2J\r\n\u202ecba"
    scene.say(MASTER_HANDSHAKE, session_id=4711, settings=evil, settings_hash=evil, software=evil)
    scene.run(0.1)
    scene.replace_master()
    scene.run(0.06)
    slave, master = scene.pair.slave.axes[0], scene.pair.master.axes[0]
    asked = {"session_id": master.session.session_id, "answers_stamp_ns": scene.now_ns}
    scene.say(SLAVE_HANDSHAKE, reason=evil, **asked)
    scene.run(0.15)
    shown = [master.session.cause(scene.now_ns)]
    scene.say(EMERGENCY_STOP, reason=evil)
    scene.run(0.2)
    shown += slave.events.notices.drain() + master.events.notices.drain()
    shown.append(scene.pair.traffic.newest(MASTER_STATE).reason)
    scene.end(Expected("handshakes_refused", 1, "estop", armed=0.0, ends="estopped"))
    assert any("owned" in text for text in shown)
    assert all(text.isprintable() for text in shown)


@pytest.mark.parametrize("settings", [{"cell": "a*"}, {"axes": [{"name": "a*"}]}])
def test_a_cell_or_axis_that_would_be_a_pattern_is_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        Pair(settings)


def test_a_second_master_gets_no_session(lasting: Scene) -> None:
    lasting.pair.start_master()
    lasting.run(1.2)
    lasting.pair.master.transport.close()
    lasting.end(Expected("handshakes_refused", 4))


def test_a_second_writer_that_numbers_from_one_is_refused(lasting: Scene) -> None:
    """Fresh commands with the session's id: all of these numbers were used."""
    for i in range(100):
        lasting.command(sequence=1 + i, stamp_ns=lasting.now_ns + 1)
        lasting.run(0.001)
    lasting.end(Expected("refused_sequence", 100, "sequence"))


def test_a_second_writer_that_numbers_ahead_ends_the_session(scene: Scene) -> None:
    """Without certificates nobody can say who the writer is; commands of a tick or two are followed."""
    session_id, first = scene.session_id, scene.sequence + 1000
    here_m = scene.pair.slave.axes[0]._watch.stage.position_m
    for i in range(100):
        scene.command(session_id=session_id, sequence=first + i, position_m=here_m + 0.04)
        scene.run(0.001)
    scene.run(_REARMED_S)
    scene.forged = set(sorted(scene.forged)[2:])
    scene.end(Expected("refused_second_writer", 1, "session_lost", armed=0.2))


def test_replayed_heartbeats_keep_no_dead_masters_lease(scene: Scene) -> None:
    recorded = scene.recorded(MASTER_HEARTBEAT)[-20:]
    scene.replace_master()
    for i in range(40):
        scene.put(MASTER_HEARTBEAT, recorded[i % 20])
        scene.run(0.05)
    scene.run(1.0)
    scene.end(Expected("heartbeats_refused", 15, "watchdog", armed=0.1))


def test_forged_heartbeats_keep_a_session_without_commands_for_three_seconds(scene: Scene) -> None:
    """Right numbers and echoes, as of one who reads along."""
    dead = scene.session_id
    scene.replace_master()
    for i in range(110):
        echo_ns = scene.echo_ns()
        scene.beat(10_000 + i, session_id=dead, echo_stamp_ns=echo_ns, echo_receive_ns=echo_ns)
        scene.run(0.05)
    scene.end(Expected("sessions_released", 1, "session_lost", armed=0.05))


def test_heartbeats_that_echo_what_was_never_sent_move_no_clock(lasting: Scene) -> None:
    """A round trip of nothing, a clock a minute off."""
    clock = lasting.pair.slave.axes[0]._session.offset
    for i in range(40):
        now_ns = lasting.now_ns
        lie = {"echo_stamp_ns": now_ns + 9 * MS, "echo_receive_ns": now_ns + 60 * S}
        lasting.beat(10_000 + i, stamp_ns=now_ns + 60 * S, **lie)
        lasting.run(0.025)
    lasting.end(Expected("heartbeats_refused", 40))
    after = lasting.pair.slave.axes[0]._session.offset
    assert clock is not None and after is not None
    assert abs(after.offset_ns - clock.offset_ns) < 2 * MS


@pytest.mark.parametrize("shift_s", [10.0, -10.0])
def test_a_clock_that_lies_makes_no_old_command_new_and_stops_nothing(lasting: Scene, shift_s: float) -> None:
    """Right echoes, as of one who reads along; then a burst of old commands."""
    session_id = lasting.session_id
    for i in range(20):
        echo_ns = lasting.echo_ns()
        lie_ns = lasting.now_ns + round(shift_s * S)
        got_ns = lie_ns - (lasting.now_ns - echo_ns)  # so that the round trip is the shortest that can be
        lasting.beat(20_000 + i, stamp_ns=lie_ns, echo_stamp_ns=echo_ns, echo_receive_ns=got_ns)
        lasting.run(0.05)
    old_ns = lasting.now_ns - 2 * S
    first = lasting.sequence + 50
    for i in range(200):
        lasting.command(session_id=session_id, sequence=first + i, stamp_ns=old_ns + i * MS)
    lasting.run(1.2)  # a session that were lost would be so after the lease of 1 s
    assert lasting.end(Expected("refused_late", 200)).counters["heartbeats_refused"] >= 20
