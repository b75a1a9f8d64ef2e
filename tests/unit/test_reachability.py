"""Why there is no answer: the causes by error, and the report every five seconds."""

import socket
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.reachability import AnswerWatch, Obstacle, Reached, cell_watch, reach, silence_cause
from tests.stepped import SteppedHost
from tests.unit.failing import refusing

S = 1_000_000_000
REFUSED = Obstacle("10.0.0.3:7447 refuses the connection", "start the slave there")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ConnectionRefusedError(), "refuses the connection"),
        (TimeoutError(), "no answer"),
        (socket.gaierror(-2, "Name or service not known"), "not known"),
        (UnicodeError("label too long"), "label too long"),
        (OSError(101, "Network is unreachable"), "Network is unreachable"),
    ],
)
def test_probe_names_the_obstacle(monkeypatch: pytest.MonkeyPatch, error: Exception, words: str) -> None:
    monkeypatch.setattr(socket, "create_connection", refusing(error))
    found = reach("tls/10.0.0.2:7447", None, "slave").obstacle
    assert found is not None and found.advice
    assert words in found.what


@pytest.mark.parametrize("endpoint", ["quic/127.0.0.1:9", "udp/127.0.0.1:9", "nonsense"])
def test_probe_of_other_protocol_is_not_tried(endpoint: str) -> None:
    assert reach(endpoint, None, "slave") == Reached(endpoint)


@pytest.mark.parametrize(
    ("transport", "connected", "words"),
    [
        ({"connect": ["tls/10.0.0.2:7447"]}, True, "is connected, but no slave"),
        ({"connect": ["tcp/10.0.0.2:7447"]}, False, "opens: certificates there need tls/"),
        ({"listen": ["tls/0.0.0.0:7447"]}, False, "nobody has connected"),
    ],
)
def test_unheard_end_is_described(transport: dict[str, object], connected: bool, words: str) -> None:
    assert words in silence_cause(TransportSettings.model_validate(transport), connected, "no slave")


def test_observer_at_a_router_is_told_the_mode() -> None:
    transport: Any = SimpleNamespace(hint="a router answers there", peers=lambda: 1)
    own = TransportSettings(connect=("tcp/127.0.0.1:9",))
    look = cell_watch(own, Party("viewer", ("cell",)), transport, VirtualClock(0))
    assert (look(False), look(True)) == ("a router answers there", "")
    transport.hint = ""
    assert "connected, but nobody of cell cell" in look(False)


class Probing(SteppedHost):
    """A host whose probes end when a test says so, if they do not end at once."""

    def __init__(self, ends: bool = True) -> None:
        super().__init__()
        self.ends = ends
        self.probes: list[Future[Any]] = []
        self.reported: list[str] = []
        self.watch = AnswerWatch(lambda: [REFUSED], lambda: "silent", self.reported.append, self)

    def in_thread(self, work: Any, name: str) -> "Future[Any]":  # noqa: ANN401 - of any result
        self.probes.append(super().in_thread(work, name) if self.ends else Future[Any]())
        return self.probes[-1]

    def look(self, *at_s: float, known: str = "") -> None:
        for each_s in at_s:
            self.watch.look(round(each_s * S), known)


def test_cause_is_reported_every_five_seconds() -> None:
    host = Probing()
    host.look(*(tenth / 10 for tenth in range(1, 161)))
    assert [each.rpartition(" (")[2] for each in host.reported] == ["5.1 s)", "10 s)", "15 s)"]
    assert len(host.probes) == 3
    assert host.watch.last_cause == host.reported[-1]


def test_one_probe_runs_at_a_time() -> None:
    host = Probing(ends=False)
    host.look(*range(30))
    assert (host.reported, len(host.probes)) == ([], 1)
    host.probes[0].set_result([REFUSED])
    host.look(30)
    assert len(host.reported) == 1 and REFUSED.what in host.reported[0]


def test_known_cause_needs_no_probe() -> None:
    host = Probing()
    host.look(*range(8), known="the slave refuses")
    assert host.reported == ["the slave refuses (5.0 s)"]
    assert (host.probes, host.watch.last_cause) == ([], "")


def test_probe_that_ends_after_the_answer_is_not_reported() -> None:
    host = Probing(ends=False)
    host.look(0, 5)
    host.watch.over()
    host.probes[0].set_result([REFUSED])
    host.look(20, 21)
    assert (host.reported, host.watch.last_cause) == ([], "")
