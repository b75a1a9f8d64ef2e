"""Mutual TLS and access control over real Zenoh: who gets through, and that nobody else does.

Attackers are sessions that follow no rule of ours; in each test a message that is allowed comes through last.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from forefeel.common.topics import COMMAND, EMERGENCY_STOP, FORCE, SAFETY_EVENT, Qos
from forefeel.common.transport.security import PartyRole
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.live_cell import free_port
from tests.secured import CELL, Secured, connected, expired_pki, make_pki, sessions
from tests.waiting import wait_until

COMMANDED = COMMAND.taken_key(CELL, "insertion")
FORCED = FORCE.taken_key(CELL, "insertion")
SHOWN = FORCE.key(CELL, "insertion")  # to observers
STOPPED = EMERGENCY_STOP.key(CELL, "insertion")
EVENTS = SAFETY_EVENT.key(CELL, "insertion")
Heard = list[tuple[str, bytes]]


@pytest.fixture
def net() -> Iterator[Secured]:
    with sessions() as net:
        yield net
    assert net.faults == []


def heard_by(transport: ZenohTransport, *keys: str) -> Heard:
    """What comes to a transport on those keys."""
    heard: Heard = []

    def listen(key: str) -> None:
        transport.subscribe(key, lambda payload, _: heard.append((key, payload)))

    for key in keys:
        listen(key)
    return heard


def until(send: Callable[[], None], condition: Callable[[], object]) -> None:
    """Repeats it, for declarations travel, too."""

    def attempt() -> object:
        send()
        return condition()

    wait_until(attempt)


def sender(transport: ZenohTransport, key: str, payload: bytes) -> Callable[[], None]:
    put = transport.publisher(key, Qos.EVENT)
    return lambda: put(payload)


def put_everything(session: zenoh.Session, who: str, cell: str = CELL) -> None:
    """On whatever might move the stage or deceive the master."""
    keys = (COMMANDED, FORCED, SHOWN, STOPPED, EVENTS, "forefeel/**", "direct/forefeel/*/insertion/**", "**")
    for key in keys:
        session.put(key.replace(f"/{CELL}/", f"/{cell}/"), f"{who} at {key}")
    session.delete(COMMANDED)


def overhear(session: zenoh.Session, key: str) -> "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]":
    """What others put; not what the session puts itself."""
    channel: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(1000)
    return session.declare_subscriber(key, channel, allowed_origin=zenoh.Locality.REMOTE)


def test_stranger_without_valid_certificate_is_not_connected(net: Secured, tmp_path: Path) -> None:
    pki, endpoint = make_pki(tmp_path / "pki"), f"tls/127.0.0.1:{free_port()}"
    slave = net.open(pki, "slave", [endpoint])
    heard = heard_by(slave, COMMANDED, STOPPED)
    foreign = make_pki(tmp_path / "foreign")  # the same names, another authority
    expired = expired_pki(tmp_path / "expired")
    strangers = {
        "no certificate": net.attacker(endpoint, None, authority=pki / "ca.crt"),
        "another authority": net.attacker(endpoint, foreign, "master", authority=pki / "ca.crt"),
        "expired": net.attacker(endpoint, expired, "master", authority=pki / "ca.crt"),
    }
    master = net.open(pki, "master", (), [endpoint])
    until(sender(master, COMMANDED, b"move"), lambda: heard)
    for who, session in strangers.items():
        put_everything(session, who)
    time.sleep(0.8)  # several more of their attempts
    assert [who for who, session in strangers.items() if connected(session)] == []
    assert slave.peers() == 1
    until(sender(master, COMMANDED, b"last"), lambda: (COMMANDED, b"last") in heard)
    assert {payload for _, payload in heard} == {b"move", b"last"}


def test_role_may_do_its_own_and_nothing_else(net: Secured, tmp_path: Path) -> None:
    pki, endpoint = make_pki(tmp_path / "pki", (CELL, "other")), f"tls/127.0.0.1:{free_port()}"
    slave = net.open(pki / CELL, "slave", [endpoint])
    heard = heard_by(slave, COMMANDED, STOPPED)
    master = net.open(pki / CELL, "master", (), [endpoint])
    forces = heard_by(master, FORCED, EVENTS)
    until(sender(master, COMMANDED, b"move"), lambda: heard)
    until(sender(slave, FORCED, b"felt"), lambda: forces)
    attackers = {
        "viewer": net.attacker(endpoint, pki / CELL, "viewer"),
        "recorder": net.attacker(endpoint, pki / CELL, "recorder"),
        "master of another cell": net.attacker(endpoint, pki / "other", "master"),
        "slave of another cell": net.attacker(endpoint, pki / "other", "slave"),
    }
    keys = ("**", "forefeel/**", f"forefeel/{CELL}/**", FORCED)
    overheard = [overhear(attackers["master of another cell"], key) for key in keys]
    seen = overhear(attackers["viewer"], SHOWN)
    wait_until(lambda: all(connected(session) for session in attackers.values()))
    for _ in range(20):
        for who, session in attackers.items():
            put_everything(session, who)
        time.sleep(0.005)
    until(lambda: attackers["viewer"].put(STOPPED, "stop"), lambda: (STOPPED, b"stop") in heard)
    until(sender(slave, SHOWN, b"shown"), lambda: seen.handler.try_recv() is not None)
    until(sender(master, COMMANDED, b"last"), lambda: (COMMANDED, b"last") in heard)
    assert {payload for key, payload in heard if key == COMMANDED} == {b"move", b"last"}
    stops = {payload for key, payload in heard if key == STOPPED}
    assert stops == {f"viewer at {STOPPED}".encode(), b"stop"}
    assert {payload for _, payload in forces} == {b"felt"}
    assert [sub.handler.try_recv() for sub in overheard] == [None] * 4


def test_router_keeps_cells_to_themselves(net: Secured, tmp_path: Path) -> None:
    cells = ("a", "b")
    pki, endpoint = make_pki(tmp_path / "pki", cells), f"tls/127.0.0.1:{free_port()}"
    router = net.router(pki, endpoint, cells)
    masters, commands = {}, {}
    for cell in cells:
        slave = net.open(pki / cell, "slave", (), [endpoint], "client", cell)
        masters[cell] = net.open(pki / cell, "master", (), [endpoint], "client", cell)
        commands[cell] = heard_by(slave, COMMAND.taken_key(cell, "insertion"))
    roles: tuple[PartyRole, ...] = ("viewer", "recorder", "slave")
    attackers = {
        f"{role} {cell}": net.attacker(endpoint, pki / cell, role) for cell in cells for role in roles
    }
    foreign = net.attacker(endpoint, pki / "b", "master")
    spies = [overhear(attackers["viewer b"], key) for key in ("forefeel/**", "forefeel/a/**")]
    for cell in cells:
        move = sender(masters[cell], COMMAND.taken_key(cell, "insertion"), cell.encode())
        until(move, lambda cell=cell: commands[cell])  # type: ignore[misc]
    wait_until(lambda: len(router.info.links()) == 11)
    for who, session in attackers.items():
        for cell in cells:
            put_everything(session, who, cell)
    put_everything(foreign, "master b", "a")
    for cell in cells:
        move = sender(masters[cell], COMMAND.taken_key(cell, "insertion"), b"last")
        until(move, lambda cell=cell: commands[cell][-1][1] == b"last")  # type: ignore[misc]
        assert {payload for _, payload in commands[cell]} == {cell.encode(), b"last"}
    assert [sub.handler.try_recv() for sub in spies] == [None, None]
