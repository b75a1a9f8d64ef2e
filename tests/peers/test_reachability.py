"""Probes of endpoints against TLS servers of the standard library."""

import socket
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from forefeel.common.transport.security import PartyFiles
from forefeel.reachability import Reached, reach
from tests.secured import deaf_address, expired_pki, identity, make_pki


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_pki(tmp_path_factory.mktemp("certificates") / "pki")


@contextmanager
def tls_server(server: PartyFiles, connections: int = 1, host: str = "127.0.0.1") -> Iterator[str]:
    """Asks for a certificate of the same authority, as the daemons do; its address. That each connection ends
    in order, or by an alert, is checked.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(server.certificate, server.key)
    context.load_verify_locations(server.authority)
    context.verify_mode = ssl.CERT_REQUIRED
    broken: list[OSError] = []

    def serve() -> None:
        for _ in range(connections):
            accepted, _ = listener.accept()
            try:
                with accepted, context.wrap_socket(accepted, server_side=True) as secured:
                    assert secured.recv(1) == b""
            except ssl.SSLError as error:
                if isinstance(error, ssl.SSLEOFError):
                    broken.append(error)
            except OSError as error:
                broken.append(error)

    with socket.create_server((host, 0)) as listener:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"{host}:{listener.getsockname()[1]}"
        thread.join()
    assert broken == []


def obstacle(found: Reached) -> str:
    assert found.obstacle is not None
    assert found.obstacle.advice
    return found.obstacle.what


def test_a_server_that_takes_our_certificate_is_reached_and_left_in_order(pki: Path) -> None:
    with tls_server(identity(pki, "slave")) as address:
        found = reach(f"tls/{address}", identity(pki, "master"), "slave")
    assert found.obstacle is None
    assert found.connect_s is not None
    assert found.handshake_s is not None
    assert 0 < found.connect_s < 2


def test_a_certificate_of_another_authority_is_refused_on_either_side(pki: Path, tmp_path: Path) -> None:
    other = make_pki(tmp_path / "pki")
    with tls_server(identity(pki, "slave")) as address:
        found = reach(f"tls/{address}", identity(other, "master"), "slave")
        assert "certificate of" in obstacle(found)
    mixed = identity(other, "master", pki / "ca.crt")
    with tls_server(identity(pki, "slave")) as address:
        found = reach(f"tls/{address}", mixed, "slave")
        assert obstacle(found).startswith(address)


def test_a_certificate_that_expired_is_told_with_its_date(tmp_path: Path) -> None:
    pki = expired_pki(tmp_path / "pki")
    with tls_server(identity(pki, "slave")) as address:
        found = reach(f"tls/{address}", identity(pki, "master"), "slave")
        assert "expired" in obstacle(found)
        assert found.obstacle is not None and "pki init" in found.obstacle.advice


def test_a_certificate_that_does_not_stand_for_the_address_is_told(pki: Path) -> None:
    with tls_server(identity(pki, "slave"), host="127.0.0.2") as address:
        found = reach(f"tls/{address}", identity(pki, "master"), "slave")
        assert "127.0.0.2" in obstacle(found)
        assert found.obstacle is not None and "--hosts" in found.obstacle.advice


def test_server_that_says_nothing_is_silent(pki: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        found = reach(f"tls/{address}", identity(pki, "master"), "slave", timeout_s=0.1)
    assert "says nothing" in obstacle(found) and found.connect_s is not None
    with deaf_address() as deaf:
        found = reach(f"tls/{deaf}", identity(pki, "master"), "slave", timeout_s=0.1)
    assert "no answer" in obstacle(found) and found.connect_s is None
