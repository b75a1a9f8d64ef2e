"""Mutual TLS and access control over real Zenoh on loopback: who gets through, and that nobody else does.

Attackers are sessions that follow no rule of ours; in each test a message that is allowed comes through last.
"""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import timedelta
from pathlib import Path

import pytest
import zenoh

from forefeel.common.clock import now_utc
from forefeel.common.codec import MAX_MESSAGE_BYTES
from forefeel.common.topics import COMMAND, EMERGENCY_STOP, FORCE, SAFETY_EVENT, Qos
from forefeel.common.transport.security import PartyRole
from forefeel.common.transport.zenoh_bus import ZenohTransport
from forefeel.pki.folder import find_members, renew
from tests.process.test_zenoh_bus import put_until
from tests.secured import CELL, Secured, expired_pki, free_endpoint, make_pki, sessions
from tests.waiting import wait_until

COMMANDED = COMMAND.key(CELL, "insertion")
FORCED = FORCE.key(CELL, "insertion")
STOPPED = EMERGENCY_STOP.key(CELL, "insertion")
EVENTS = SAFETY_EVENT.key(CELL, "insertion")
Heard = list[tuple[str, bytes]]


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_pki(tmp_path_factory.mktemp("certificates") / "pki", hosts={"slave": ["127.0.0.1"]})


@pytest.fixture
def net() -> Iterator[Secured]:
    with sessions() as net:
        yield net
    assert net.faults == []


def heard_by(transport: ZenohTransport, *keys: str) -> Heard:
    """What comes to a transport on those keys."""
    heard: Heard = []

    def listen(key: str) -> None:
        if key.endswith("/**"):
            transport.subscribe_all(key[:-3], lambda at, payload, _: heard.append((at, payload)))
        else:
            transport.subscribe(key, lambda payload, _: heard.append((key, payload)))

    for key in keys:
        listen(key)
    return heard


def sender(transport: ZenohTransport, key: str, payload: bytes) -> Callable[[], None]:
    put = transport.publisher(key, Qos.EVENT)
    return lambda: put(payload)


def until(send: Callable[[], None], condition: Callable[[], object]) -> None:
    put_until(lambda _: send(), condition)


def everything(session: zenoh.Session, who: str, cell: str = CELL) -> None:
    """Puts on, deletes and floods whatever might move the stage or deceive the master."""
    keys = (COMMANDED, FORCED, STOPPED, EVENTS, "forefeel/**", "forefeel/*/insertion/master/command", "**")
    for key in keys:
        session.put(key.replace(f"/{CELL}/", f"/{cell}/"), f"{who} at {key}")
    session.delete(COMMANDED)


def overhear(session: zenoh.Session, key: str) -> "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]":
    """What others put; not what the session puts itself."""
    channel: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(1000)
    return session.declare_subscriber(key, channel, allowed_origin=zenoh.Locality.REMOTE)


def connected(session: zenoh.Session) -> bool:
    return bool(session.info.transports())


@pytest.mark.parametrize("protocol", ["tls", pytest.param("quic", marks=pytest.mark.soak)])
def test_each_role_says_and_hears_what_is_its_own(net: Secured, pki: Path, protocol: str) -> None:
    at_slave, at_master = free_endpoint(protocol), free_endpoint(protocol)
    slave = net.open(pki, "slave", [at_slave])
    master = net.open(pki, "master", [at_master], [at_slave])
    viewer, recorder = (net.open(pki, role, (), [at_slave, at_master]) for role in ("viewer", "recorder"))
    to_slave, to_master = heard_by(slave, COMMANDED, STOPPED), heard_by(master, FORCED, STOPPED)
    seen = [heard_by(observer, f"forefeel/{CELL}/**") for observer in (viewer, recorder)]
    until(sender(master, COMMANDED, b"move"), lambda: (COMMANDED, b"move") in to_slave)
    until(sender(slave, FORCED, b"felt"), lambda: (FORCED, b"felt") in to_master)
    until(
        sender(viewer, STOPPED, b"stop"),
        lambda: (STOPPED, b"stop") in to_slave and (STOPPED, b"stop") in to_master,
    )
    for at_observer in seen:
        until(sender(master, COMMANDED, b"move"), lambda at=at_observer: (COMMANDED, b"move") in at)  # type: ignore[misc]
        until(sender(slave, FORCED, b"felt"), lambda at=at_observer: (FORCED, b"felt") in at)  # type: ignore[misc]
    assert (slave.hint, master.hint) == ("", "")
    links = {link.auth_identifier for link in slave._session.info.links()}
    assert links == {f"forefeel-{CELL}-{role}" for role in ("master", "viewer", "recorder")}


def test_who_is_not_in_the_cell_is_not_let_in(net: Secured, pki: Path, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    slave = net.open(pki, "slave", [endpoint])
    heard = heard_by(slave, COMMANDED, STOPPED)
    foreign = make_pki(tmp_path / "foreign")  # the same names, another authority
    expired = expired_pki(tmp_path / "expired")
    intruders = {
        "no certificate": net.attacker(endpoint, None, authority=pki / "ca.crt"),
        "another authority": net.attacker(endpoint, foreign, "master", authority=pki / "ca.crt"),
        "expired": net.attacker(endpoint, expired, "master", authority=pki / "ca.crt"),
    }
    master = net.open(pki, "master", (), [endpoint])
    until(sender(master, COMMANDED, b"move"), lambda: heard)
    for who, session in intruders.items():
        everything(session, who)
    time.sleep(0.8)  # several more of their attempts
    assert [who for who, session in intruders.items() if connected(session)] == []
    assert slave.peers() == 1
    until(sender(master, COMMANDED, b"last"), lambda: (COMMANDED, b"last") in heard)
    assert {payload for _, payload in heard} == {b"move", b"last"}


def test_an_expired_certificate_of_the_right_authority_is_not_let_in(net: Secured, tmp_path: Path) -> None:
    pki, endpoint = make_pki(tmp_path / "pki"), free_endpoint()
    slave = net.open(pki, "slave", [endpoint])
    heard = heard_by(slave, COMMANDED)
    members = [each for each in find_members(pki) if each.party.role == "master"]
    renew(pki, members, {}, 1, now_utc() - timedelta(days=3))
    expired = net.attacker(endpoint, pki, "master")
    everything(expired, "expired")
    time.sleep(0.5)
    assert not connected(expired)
    renew(pki, members, {}, 1, now_utc())
    renewed = net.open(pki, "master", (), [endpoint])
    until(sender(renewed, COMMANDED, b"renewed"), lambda: heard)
    assert {payload for _, payload in heard} == {b"renewed"}


def test_a_role_does_its_own_and_nothing_else(net: Secured, tmp_path: Path) -> None:
    pki, endpoint = make_pki(tmp_path / "pki", (CELL, "other")), free_endpoint()
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
        "master by wildcard": net.attacker(endpoint, pki / CELL, "master"),
    }
    overheard = [
        overhear(attackers["master of another cell"], key)
        for key in ("**", "forefeel/**", f"forefeel/{CELL}/**", FORCED)
    ]
    wait_until(lambda: all(connected(session) for session in attackers.values()))
    attackers.pop("master by wildcard").put("forefeel/*/insertion/master/command", "wildcard")
    for _ in range(20):
        for who, session in attackers.items():
            everything(session, who)
        time.sleep(0.005)
    until(lambda: attackers["viewer"].put(STOPPED, "stop"), lambda: (STOPPED, b"stop") in heard)
    sender(slave, FORCED, b"felt")()
    until(sender(master, COMMANDED, b"last"), lambda: (COMMANDED, b"last") in heard)
    assert {payload for key, payload in heard if key == COMMANDED} == {b"move", b"last"}
    stops = {payload for key, payload in heard if key == STOPPED}
    assert stops == {f"viewer at {STOPPED}".encode(), b"stop"}
    assert {payload for _, payload in forces} == {b"felt"}
    assert [sub.handler.try_recv() for sub in overheard] == [None] * 4


def test_without_the_rules_the_same_attack_gets_through(
    net: Secured, pki: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So the tests here would notice if the rules were gone."""
    allow = {"enabled": False, "default_permission": "allow", "rules": [], "subjects": [], "policies": []}
    monkeypatch.setattr("forefeel.common.transport.security.access_control", lambda party: allow)
    endpoint = free_endpoint()
    heard = heard_by(net.open(pki, "slave", [endpoint]), COMMANDED)
    viewer = net.attacker(endpoint, pki, "viewer")
    until(lambda: everything(viewer, "viewer"), lambda: heard)
    assert (COMMANDED, f"viewer at {COMMANDED}".encode()) in heard


@pytest.mark.soak
def test_what_is_larger_than_any_message_of_ours_is_dropped_at_the_door(net: Secured, pki: Path) -> None:
    endpoint = free_endpoint()
    heard = heard_by(net.open(pki, "slave", [endpoint]), COMMANDED)
    master = net.attacker(endpoint, pki, "master")
    until(lambda: master.put(COMMANDED, b"first"), lambda: heard)
    for size in (MAX_MESSAGE_BYTES + 1, 300_000, 5_000_000):
        master.put(COMMANDED, bytes(size))
    until(lambda: master.put(COMMANDED, bytes(MAX_MESSAGE_BYTES)), lambda: len(heard[-1][1]) > 5)
    assert {len(payload) for _, payload in heard} == {5, MAX_MESSAGE_BYTES}


def test_a_server_that_is_not_who_was_called_is_not_spoken_to(net: Secured, pki: Path) -> None:
    """The certificate of the slave stands for 127.0.0.1 and not for another address of the same host."""
    endpoint = free_endpoint()
    slave = net.open(pki, "slave", [endpoint.replace("127.0.0.1", "0.0.0.0")])
    heard = heard_by(slave, COMMANDED)
    misled = net.open(pki, "master", (), [endpoint.replace("127.0.0.1", "127.0.0.2")])
    put = sender(misled, COMMANDED, b"misled")
    for _ in range(10):
        put()
        time.sleep(0.05)
    assert (misled.peers(), slave.peers()) == (0, 0)
    until(sender(net.open(pki, "master", (), [endpoint]), COMMANDED, b"right"), lambda: heard)
    assert {payload for _, payload in heard} == {b"right"}


def test_a_router_keeps_the_cells_to_themselves(net: Secured, tmp_path: Path) -> None:
    cells = ("a", "b")
    pki, endpoint = make_pki(tmp_path / "pki", cells), free_endpoint()
    router = net.router(pki, endpoint, cells)
    slaves, masters, commands, seen = {}, {}, {}, {}
    for cell in cells:
        slaves[cell] = net.open(pki / cell, "slave", (), [endpoint], "client", cell)
        masters[cell] = net.open(pki / cell, "master", (), [endpoint], "client", cell)
        recorder = net.open(pki / cell, "recorder", (), [endpoint], "client", cell)
        commands[cell] = heard_by(slaves[cell], COMMAND.key(cell, "insertion"))
        seen[cell] = heard_by(recorder, f"forefeel/{cell}/**")
    roles: tuple[PartyRole, ...] = ("viewer", "recorder", "slave")
    attackers = {
        f"{role} {cell}": net.attacker(endpoint, pki / cell, role) for cell in cells for role in roles
    }
    spies = [overhear(attackers["viewer b"], key) for key in ("forefeel/**", "forefeel/a/**")]
    for cell in cells:
        move = sender(masters[cell], COMMAND.key(cell, "insertion"), cell.encode())
        until(move, lambda cell=cell: commands[cell] and seen[cell])  # type: ignore[misc]
    wait_until(lambda: len(router.info.links()) == 12)
    for who, session in attackers.items():
        for cell in cells:
            everything(session, who, cell)
    foreign = net.attacker(endpoint, pki / "b", "master")
    wait_until(lambda: connected(foreign))
    everything(foreign, "master b", "a")
    for cell in cells:
        move = sender(masters[cell], COMMAND.key(cell, "insertion"), b"last")
        until(move, lambda cell=cell: commands[cell][-1][1] == b"last" == seen[cell][-1][1])  # type: ignore[misc]
        assert {payload for _, payload in commands[cell]} == {cell.encode(), b"last"}
        assert all(key.startswith(f"forefeel/{cell}/") for key, _ in seen[cell])
    assert [sub.handler.try_recv() for sub in spies] == [None, None]


@pytest.mark.soak
def test_a_peer_at_a_router_is_told_so(net: Secured, pki: Path) -> None:
    endpoint = free_endpoint()
    net.router(pki, endpoint, [CELL])
    peer = net.open(pki, "recorder", (), [endpoint])
    wait_until(lambda: peer.hint == "a router answers there; expected transport.mode client")


@pytest.mark.soak
def test_the_router_says_who_comes_and_goes(
    net: Secured, pki: Path, run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint = free_endpoint()

    def visit() -> None:
        viewer = net.open(pki, "viewer", (), [endpoint])
        wait_until(lambda: viewer.peers() == 1)
        time.sleep(0.8)  # a router lets in half a second before it says that it listens
        viewer.close()

    visitor = threading.Thread(target=visit)
    visitor.start()
    line = f"router --listen {endpoint} --pki {pki} --cell {CELL} --duration 4"
    assert run(line.split()) == 0
    visitor.join()
    first, came, left, last = capsys.readouterr().err.splitlines()
    assert first == f"router: listening on {endpoint} with the certificates in {pki}; cells {CELL}"
    assert came.startswith(f"router: forefeel-{CELL}-viewer came from 127.0.0.1:")
    assert left == came.replace("came from", "left")
    assert last == "router: closed"


def test_an_insecure_start_is_loud(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    port = free_endpoint("tcp").rpartition(":")[2]
    text = f"role: slave\ntransport: {{listen: ['tcp/0.0.0.0:{port}']}}\n"
    (tmp_path / "slave.yaml").write_text(text)
    line = f"slave --config {tmp_path}/slave.yaml --duration 0.1 --insecure"
    assert run(line.split()) == 0
    assert f"slave: INSECURE: tcp/0.0.0.0:{port}: not encrypted" in capsys.readouterr().err
