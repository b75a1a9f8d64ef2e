"""What a master that waits says of a real network: sockets, TLS and Zenoh on this host."""

from collections.abc import Callable, Iterator
from datetime import timedelta
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from forefeel import session
from forefeel.common.clock import MonotonicClock, now_utc
from forefeel.common.topics import COMMAND
from forefeel.common.transport.parallel import ParallelTransport
from forefeel.common.transport.settings import TransportSettings
from forefeel.master.daemon import MasterDaemon
from forefeel.master.session import Session
from forefeel.master.settings import MasterSettings
from forefeel.pki.folder import find_members, renew
from forefeel.reaching import reach
from forefeel.session import MasterSession, obstacles
from tests.process.test_zenoh_bus import put_until
from tests.secured import (
    CELL,
    Secured,
    deaf_address,
    expired_pki,
    free_endpoint,
    identity,
    make_pki,
    sessions,
)
from tests.waiting import wait_until

Ago = Callable[[timedelta], None]


@pytest.fixture
def net() -> Iterator[Secured]:
    with sessions() as opened:
        yield opened
    assert opened.faults == []


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    return make_pki(tmp_path / "pki")


@pytest.fixture
def opened_ago(monkeypatch: pytest.MonkeyPatch) -> Ago:
    """Sessions are opened as they would have been that long ago: a certificate expires while one runs."""

    def open_ago(ago: timedelta) -> None:
        for place in ("forefeel.common.transport.zenoh_bus", "forefeel.waiting"):
            monkeypatch.setattr(f"{place}.now_utc", lambda: now_utc() - ago)

    return open_ago


class Waiter:
    """A master's transport and what it says while no slave answers. Its certificates are read here."""

    def __init__(self, net: Secured, pki: Path, endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.said: list[str] = []
        monkeypatch.setattr("forefeel.waiting.EVERY_NS", 100_000_000)
        monkeypatch.setattr(session, "say", self.said.append)
        settings = MasterSettings(
            cell=CELL, transport=TransportSettings(connect=(endpoint,), pki=pki), peer_timeout_s=None
        )
        self.transport = net.open(pki, "master", (), [endpoint])
        self.session = Session(count(1).__next__)
        daemon = SimpleNamespace(axes=[SimpleNamespace(name="insertion", session=self.session)])
        self.master_session = MasterSession(
            cast(MasterDaemon, daemon),
            settings,
            cast(ParallelTransport, self.transport),
            obstacles(settings, "master"),
        )

    def cause(self) -> str:
        """What it says first, without the time; that its status says the same is checked."""
        clock, number = MonotonicClock(), len(self.said)

        def heard() -> bool:
            self.master_session.look(clock.now_ns())
            return len(self.said) > number

        wait_until(heard)
        cause = self.said[number].removeprefix("master: waiting for the slave: ")
        found = self.master_session._waiting.found
        assert found in {"", cause}
        assert not found or self.session.cause(clock.now_ns()) == cause
        return cause.rpartition(" (")[0] or cause.rpartition(" for ")[0]


def test_nobody_there(net: Secured, pki: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with deaf_address() as address:
        assert Waiter(net, pki, f"tls/{address}", monkeypatch).cause() == f"no answer from {address}"


def test_a_refused_connection_then_a_slave_of_another_cell(
    net: Secured, pki: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint = free_endpoint()
    address = endpoint.removeprefix("tls/")
    waiter = Waiter(net, pki, endpoint, monkeypatch)
    assert waiter.cause() == f"{address} refuses the connection: start the slave there"
    net.open(pki, "slave", [endpoint])  # a transport that says nothing
    wait_until(lambda: waiter.transport.peers() == 1)
    assert (
        waiter.cause() == f"{address} is connected, but no slave of cell {CELL}, axis insertion answers there"
    )


def test_our_certificate_expired_while_the_master_ran(
    net: Secured, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened_ago: Ago
) -> None:
    pki, endpoint = expired_pki(tmp_path / "pki"), free_endpoint()
    opened_ago(timedelta(days=2))
    net.open(pki, "slave", [endpoint])
    waiter = Waiter(net, pki, endpoint, monkeypatch)
    opened_ago(timedelta(0))
    expired = f"our certificate expired yesterday ({pki}/master.crt): "
    assert waiter.cause().startswith(f"{expired}forefeel pki renew")
    members = [each for each in find_members(pki) if each.party.role == "master"]
    renew(pki, members, {}, 1, now_utc())
    assert waiter.cause() == f"{expired}it was renewed: start anew"


def test_the_certificate_of_the_slave_expired_while_it_ran(
    net: Secured, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened_ago: Ago
) -> None:
    pki, endpoint = expired_pki(tmp_path / "pki"), free_endpoint()
    opened_ago(timedelta(days=2))
    net.open(pki, "slave", [endpoint])
    opened_ago(timedelta(0))
    members = [each for each in find_members(pki) if each.party.role == "master"]
    renew(pki, members, {}, 1, now_utc())
    assert (
        Waiter(net, pki, endpoint, monkeypatch)
        .cause()
        .startswith(
            f"the certificate of {endpoint.removeprefix('tls/')} expired yesterday: forefeel pki renew"
        )
    )


def test_a_slave_of_another_authority(
    net: Secured, pki: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint = free_endpoint()
    net.open(make_pki(tmp_path / "other"), "slave", [endpoint])
    assert (
        Waiter(net, pki, endpoint, monkeypatch)
        .cause()
        .startswith(f"the certificate of {endpoint.removeprefix('tls/')} is of another authority")
    )


def test_a_slave_whose_certificate_does_not_name_its_address(
    net: Secured, pki: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint = free_endpoint().replace("127.0.0.1", "127.0.0.2")
    net.open(pki, "slave", [endpoint])
    assert (
        Waiter(net, pki, endpoint, monkeypatch)
        .cause()
        .startswith(f"the certificate of {endpoint.removeprefix('tls/')} does not name 127.0.0.2")
    )


def test_probes_disturb_nobody_who_is_connected(net: Secured, pki: Path) -> None:
    endpoint = free_endpoint()
    slave, master = net.open(pki, "slave", [endpoint]), net.open(pki, "master", (), [endpoint])
    wait_until(lambda: slave.peers() == master.peers() == 1)
    heard: list[bytes] = []
    slave.subscribe(COMMAND.key(CELL, "insertion"), lambda payload, _: heard.append(payload))
    put = master.publisher(COMMAND.key(CELL, "insertion"), COMMAND.qos)
    for number in range(5):
        assert reach(endpoint, identity(pki, "master"), "slave").obstacle is None
        assert (slave.peers(), master.peers()) == (1, 1)
        put_until(lambda _: put(b"%d" % number), lambda: b"%d" % number in heard)  # noqa: B023 - at once
