"""Why there is no answer: the causes by error, and the report every five seconds."""

import socket
import ssl
from concurrent.futures import Future
from datetime import timedelta
from pathlib import Path
from typing import Any, cast

import pytest

from forefeel.common.clock import now_utc
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.reachability import AnswerWatch, Obstacle, Obstacles, obstacle_text, reach, unheard
from tests.secured import CELL, make_pki
from tests.stepped import SteppedHost
from tests.unit.failing import refusing

S = 1_000_000_000
SILENT = Obstacle("no answer from 10.0.0.2:7447", "check the cable", silent=True)
REFUSED = Obstacle("10.0.0.3:7447 refuses the connection", "start the slave there")


@pytest.mark.parametrize(
    ("error", "words", "silent"),
    [
        (ConnectionRefusedError(), "refuses the connection", False),
        (TimeoutError(), "no answer", True),
        (socket.gaierror(), "does not resolve", False),
        (UnicodeError("label too long"), "does not resolve", False),
        (OSError(101, "Network is unreachable"), "Network is unreachable", False),
    ],
)
def test_probe_names_the_obstacle(
    monkeypatch: pytest.MonkeyPatch, error: Exception, words: str, silent: bool
) -> None:
    monkeypatch.setattr(socket, "create_connection", refusing(error))
    found = reach("tls/10.0.0.2:7447", None, "slave").obstacle
    assert found is not None and found.advice
    assert (words in found.what, found.silent) == (True, silent)


@pytest.mark.parametrize("endpoint", ["quic/127.0.0.1:9", "udp/127.0.0.1:9", "nonsense"])
def test_probe_of_other_protocol_is_not_tried(endpoint: str) -> None:
    assert not reach(endpoint, None, "slave").tried


def test_endpoint_that_can_not_be_tried_is_silent() -> None:
    transport = TransportSettings(connect=("quic/10.0.0.2:7447",))
    obstacles = Obstacles(transport, Party("master", ("cell",)), "slave")
    assert [each.silent for each in obstacles.find()] == [True]


def test_several_obstacles_stand_in_one_line() -> None:
    assert obstacle_text([SILENT, REFUSED], "12 s") == (
        "no answer from 10.0.0.2:7447 for 12 s; "
        "10.0.0.3:7447 refuses the connection: start the slave there (12 s)"
    )


@pytest.mark.parametrize(
    ("transport", "connected", "words"),
    [
        ({"connect": ["tls/10.0.0.2:7447"]}, True, "is connected, but no slave"),
        ({"connect": ["tls/10.0.0.2:7447"]}, False, "none of Zenoh opens"),
        ({"listen": ["tls/0.0.0.0:7447"]}, False, "nobody has connected"),
    ],
)
def test_unheard_end_is_described(transport: dict[str, object], connected: bool, words: str) -> None:
    assert words in unheard(TransportSettings.model_validate(transport), connected, "no slave")


class Probing(SteppedHost):
    """A host whose probes end when a test says so."""

    def __init__(self, *found: Obstacle) -> None:
        super().__init__()
        self.found, self.ends = list(found), True
        self.probes: list[Future[Any]] = []
        self.reported: list[str] = []
        self.watch = AnswerWatch(cast(Obstacles, self), lambda: "silent", self.reported.append, self)

    def find(self) -> list[Obstacle]:
        return self.found

    def in_thread(self, work: Any, name: str) -> "Future[Any]":  # noqa: ANN401 - of any result
        future = super().in_thread(work, name) if self.ends else Future[Any]()
        self.probes.append(future)
        return future


def test_cause_is_reported_every_five_seconds() -> None:
    host = Probing(SILENT)
    for tenth in range(1, 161):
        host.watch.look(round(tenth * S / 10))
    assert host.reported == [f"{SILENT.what} for {waited}" for waited in ("5.1 s", "10 s", "15 s")]
    assert len(host.probes) == 3
    assert host.watch.found == host.reported[-1]


def test_one_probe_runs_at_a_time() -> None:
    host = Probing(REFUSED)
    host.ends = False
    for at_s in range(30):
        host.watch.look(at_s * S)
    assert (host.reported, len(host.probes)) == ([], 1)
    host.probes[0].set_result([REFUSED])
    host.watch.look(30 * S)
    assert len(host.reported) == 1 and REFUSED.what in host.reported[0]


def test_known_cause_needs_no_probe() -> None:
    host = Probing(REFUSED)
    for at_s in range(8):
        host.watch.look(at_s * S, "the slave refuses")
    assert host.reported == ["the slave refuses (5.0 s)"]
    assert (host.probes, host.watch.found) == ([], "")


def test_probe_that_ends_after_the_answer_is_not_reported() -> None:
    host = Probing(REFUSED)
    host.ends = False
    for at_s in (0, 5):
        host.watch.look(at_s * S)
    host.watch.over()
    host.probes[0].set_result([REFUSED])
    for at_s in (20, 21):
        host.watch.look(at_s * S)
    assert (host.reported, host.watch.found) == ([], "")


def test_certificate_error_is_named_by_its_code(monkeypatch: pytest.MonkeyPatch) -> None:
    for code, words in (
        (10, "expired"),
        (9, "not valid yet"),
        (62, "does not name"),
        (18, "another authority"),
    ):
        error = ssl.SSLCertVerificationError()
        error.verify_code, error.verify_message = code, "x"
        monkeypatch.setattr(socket, "create_connection", refusing(error))
        found = reach("tls/10.0.0.2:7447", None, "slave").obstacle
        assert found is not None and words in found.what


def test_own_certificate_that_expired_is_named_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    transport = TransportSettings(connect=("tls/127.0.0.1:9",), pki=make_pki(tmp_path / "pki"))
    obstacles = Obstacles(transport, Party("master", (CELL,)), "slave")
    assert "refuses the connection" in obstacles.find()[0].what
    monkeypatch.setattr("forefeel.reachability.now_utc", lambda: now_utc() + timedelta(days=20_000))
    assert all("expired" in each.what for each in obstacles.find())
