"""How streams take turns between connections, and which settings of that can not work."""

import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import cast

import pytest
import zenoh

from common.clock import MonotonicClock
from common.errors import EndpointError
from common.topics import Qos
from common.transport.endpoints import port_of, shifted
from common.transport.settings import TransportSettings
from common.transport.strands import StrandedTransport, in_turn
from common.transport.zenoh_bus import ZenohTransport
from forefeel.strand_watch import StrandWatch


class Outlet:
    """Keeps what was put, while it is heard."""

    def __init__(self) -> None:
        self.heard = True
        self.sent: list[bytes] = []

    def is_heard(self) -> bool:
        return self.heard


def test_each_outlet_has_its_turn_and_one_that_is_not_heard_is_left_out() -> None:
    outlets = [Outlet() for _ in range(3)]
    put = in_turn([(outlet.sent.append, outlet.is_heard) for outlet in outlets])
    for number in range(6):
        put(b"%d" % number)
    assert [outlet.sent for outlet in outlets] == [[b"0", b"3"], [b"1", b"4"], [b"2", b"5"]]
    outlets[1].heard = False
    for number in range(6, 12):
        put(b"%d" % number)
    assert len(outlets[1].sent) == 2
    assert sorted(outlets[0].sent[2:] + outlets[2].sent[2:], key=int) == [b"%d" % n for n in range(6, 12)]


def test_where_nobody_is_known_to_listen_the_first_one_is_used() -> None:
    outlets = [Outlet(), Outlet()]
    put = in_turn([(outlet.sent.append, lambda: False) for outlet in outlets])
    put(b"a")
    put(b"b")
    assert [outlet.sent for outlet in outlets] == [[b"a", b"b"], []]


class Publication:
    """A session with one publisher: somebody comes, or goes, while it is asked whether anybody is there."""

    def __init__(self, found: bool, meanwhile: bool | None) -> None:
        self.tell: Callable[[SimpleNamespace], None] = lambda _: None
        self._found, self._meanwhile = found, meanwhile

    def __enter__(self) -> "Publication":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def declare_publisher(self, *_: object, **__: object) -> "Publication":
        return self

    def put(self, payload: bytes) -> None:
        pass

    def undeclare(self) -> None:
        pass

    def declare_matching_listener(self, tell: Callable[[SimpleNamespace], None]) -> "Publication":
        self.tell = tell
        return self

    @property
    def matching_status(self) -> SimpleNamespace:
        if self._meanwhile is not None:
            self.tell(SimpleNamespace(matching=self._meanwhile))
        return SimpleNamespace(matching=self._found)


@pytest.mark.parametrize(
    ("found", "meanwhile", "heard"),
    [(False, True, True), (True, False, False), (True, None, True), (False, None, False)],
)
def test_who_comes_or_goes_while_the_outlet_is_made_counts(
    found: bool, meanwhile: bool | None, heard: bool
) -> None:
    session = Publication(found, meanwhile)
    transport = ZenohTransport(cast(zenoh.Session, session), MonotonicClock(), print)
    _, is_heard = transport.heard_publisher("forefeel/c/a/slave/force", Qos.STREAM)
    assert is_heard() is heard
    session.tell(SimpleNamespace(matching=not heard))
    assert is_heard() is not heard
    session.tell(SimpleNamespace(matching=heard))
    assert is_heard() is heard
    transport.close()


@pytest.mark.parametrize(
    ("endpoint", "moved"),
    [
        ("tls/10.0.0.1:7447", "tls/10.0.0.1:7450"),
        ("quic/[::1]:7447?mixed_rel=1#iface=lo", "quic/[::1]:7450?mixed_rel=1#iface=lo"),
    ],
)
def test_only_the_port_is_another(endpoint: str, moved: str) -> None:
    assert shifted(endpoint, 3) == moved
    assert (shifted(endpoint, 0), port_of(moved)) == (endpoint, 7450)


def test_a_malformed_endpoint_is_named_there_too() -> None:
    with pytest.raises(EndpointError, match="expected protocol/host:port"):
        port_of("tls/nowhere")


@pytest.mark.parametrize(
    ("listen", "why"),
    [
        (("tls/127.0.0.1:7447", "tls/127.0.0.1:7449"), "within the 3 ports of another one from 7447"),
        (("tls/127.0.0.1:65534",), "the port 1 to 65535"),
    ],
)
def test_ports_that_can_not_be_had_are_named(listen: tuple[str, ...], why: str) -> None:
    settings = TransportSettings(listen=listen, strands=3)
    with pytest.raises(EndpointError, match=re.escape(why)):
        StrandedTransport.open(settings, MonotonicClock(), print, insecure=True)


def test_a_client_of_a_router_has_one_connection() -> None:
    with pytest.raises(ValueError, match="strands = 2: expected 1 with mode 'client'"):
        TransportSettings(mode="client", connect=("tls/127.0.0.1:7447",), strands=2)


def test_what_is_amiss_is_said_once_when_it_lasts() -> None:
    class Link:
        def __init__(self) -> None:
            self.amiss = ""

    link, said = Link(), list[str]()
    watch = StrandWatch(link, said.append)
    for amiss in ("", "", "1 of 2", "", "1 of 2", "1 of 2", "1 of 2", "", ""):
        link.amiss = amiss
        watch.look(0)
    assert said == ["link: 1 of 2", "link: all connections stand again"]
