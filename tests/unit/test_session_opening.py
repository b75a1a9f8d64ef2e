"""How a daemon comes to its network and a master to its slave, with fakes in the place of both."""

import asyncio
from itertools import count
from threading import Event
from types import SimpleNamespace
from typing import Any, cast

import pytest

from forefeel import session
from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError, EndpointError, NoRouterError
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.transport.parallel import ParallelTransport
from forefeel.master.daemon import MasterDaemon
from forefeel.master.session import Session, SessionState
from forefeel.master.settings import MasterSettings
from forefeel.reaching import Obstacle
from forefeel.session import MasterSession, obstacles, open_session, opened
from forefeel.slave.settings import SlaveSettings
from forefeel.waiting import Obstacles

S = 1_000_000_000
CONNECT = {"transport": {"connect": ["tcp/127.0.0.1:9"]}}


@pytest.fixture(name="said")
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    said: list[str] = []
    monkeypatch.setattr(session, "say", said.append)
    return said


class FakeTransport:
    """Connected to as many as a test says."""

    def __init__(self) -> None:
        self.count = 0
        self.hint = self.notice = ""
        self.closed = Event()

    def peers(self) -> int:
        return self.count

    def close(self) -> None:
        self.closed.set()


class FoundObstacles:
    """Says at once what is in the way, and counts how often it was asked."""

    def __init__(self) -> None:
        self.trials = 0

    def find(self) -> list[Obstacle]:
        self.trials += 1
        return [Obstacle("10.0.0.2:7447 refuses the connection", "start the slave there")]


class Bench:
    """A master of one axis that waits for its slave."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - of YAML
        self.session, self.transport = Session(count(11).__next__), FakeTransport()
        self.obstacles = FoundObstacles()
        daemon = SimpleNamespace(axes=[SimpleNamespace(name="insertion", session=self.session)])
        self.master_session = MasterSession(
            cast(MasterDaemon, daemon),
            checked(MasterSettings, CONNECT | settings, "master"),
            cast(ParallelTransport, self.transport),
            cast(Obstacles, self.obstacles),
        )

    def wait(self, from_s: int, until_s: int) -> None:
        for now_s in range(from_s, until_s):
            self.session.should_ask(now_s * S)
            self.master_session.look(now_s * S)
            if self.master_session._waiting._trial is not None:
                self.master_session._waiting._trial.result(5.0)

    def answer(self, accepted: bool, now_s: int, reason: str = "") -> None:
        self.session.answered(self.session.session_id, accepted, reason, now_s * S, now_s * S)


def test_a_master_without_any_connection_says_what_is_in_the_way_in_its_status_too(said: list[str]) -> None:
    bench = Bench()
    bench.wait(0, 8)
    cause = "10.0.0.2:7447 refuses the connection: start the slave there (6.0 s)"
    assert said == [f"master: waiting for the slave: {cause}"]
    assert bench.session.cause(8 * S) == cause
    assert bench.obstacles.trials == 1


def test_a_master_that_is_connected_tries_nothing_and_names_who_is_missing(said: list[str]) -> None:
    bench = Bench(cell="cathlab")
    bench.transport.count = 1
    bench.wait(0, 8)
    assert said == [
        "master: waiting for the slave: 127.0.0.1:9 is connected, "
        "but no slave of cell cathlab, axis insertion answers there (5.0 s)"
    ]
    assert bench.obstacles.trials == 0


def test_who_is_connected_to_a_master_that_listens_need_not_be_the_slave(said: list[str]) -> None:
    bench = Bench(transport={"connect": ["tcp/127.0.0.1:9"], "listen": ["tcp/127.0.0.1:8"]})
    bench.transport.count = 1
    bench.wait(0, 8)
    assert (len(said), bench.obstacles.trials) == (1, 1)
    assert "refuses the connection" in said[0]


def test_a_router_in_the_place_of_the_slave_is_named(said: list[str]) -> None:
    bench = Bench()
    bench.transport.count, bench.transport.hint = 1, "a router answers there"
    bench.wait(0, 8)
    assert said == ["master: waiting for the slave: a router answers there (5.0 s)"]


def test_the_word_of_a_slave_that_refuses_is_said(said: list[str]) -> None:
    bench = Bench()
    bench.transport.count = 1
    for now_s in range(8):
        bench.answer(False, now_s, "another session holds the lease")
        bench.wait(now_s, now_s + 1)
    assert said == [
        "master: waiting for the slave: axis insertion: "
        "the slave refuses: another session holds the lease (5.0 s)"
    ]


def test_a_session_that_is_lost_and_comes_back_is_said_with_its_cause(said: list[str]) -> None:
    bench = Bench()
    bench.answer(True, 0)
    assert bench.master_session.look(0)
    bench.wait(2, 9)
    assert said == [
        "master: axis insertion: no state from the slave for 2.0 s; waiting for the slave",
        "master: waiting for the slave: 10.0.0.2:7447 refuses the connection: start the slave there (6.0 s)",
    ]
    bench.answer(True, 9)
    assert bench.master_session.look(9 * S)
    assert said[2:] == ["master: session open again"]
    assert bench.session.state is SessionState.OPEN


def test_settings_that_differ_end_the_wait(said: list[str]) -> None:
    bench = Bench()
    bench.session.should_ask(0)
    bench.answer(False, 0, "settings differ: kind: insertion here, rotation there")
    with pytest.raises(ConfigurationError, match="the slave refuses: settings differ: kind"):
        bench.master_session.look(0)
    assert said == []


def test_a_master_that_may_wait_no_longer_says_the_cause(said: list[str]) -> None:
    async def wait() -> None:
        await open_session(Bench().master_session, RealRuntime(), 0.1)

    with pytest.raises(EndpointError) as caught:
        asyncio.run(wait())
    assert str(caught.value) == (
        "no session with a slave within 0.1 s (peer_timeout_s): "
        "10.0.0.2:7447 refuses the connection: start the slave there (0.1 s)"
    )
    assert said == []


# --- opening the transport ---


ROUTED = {"transport": {"mode": "client", "connect": ["tcp/127.0.0.1:9"]}}


def test_a_signal_is_heard_while_the_transport_is_being_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    transport, may_open, entered = FakeTransport(), Event(), Event()

    def blocked(*_: object, **__: object) -> FakeTransport:
        entered.set()
        assert may_open.wait(5.0)
        return transport

    async def stop_meanwhile() -> object:
        runtime, settings = RealRuntime(), checked(SlaveSettings, ROUTED, "slave")
        opening = asyncio.create_task(
            opened(settings, "slave", runtime, False, None, obstacles(settings, "slave"))
        )
        await asyncio.to_thread(entered.wait, 5.0)
        runtime.stop()
        return await asyncio.wait_for(opening, 1.0)

    monkeypatch.setattr(ParallelTransport, "open", blocked)
    assert asyncio.run(stop_meanwhile()) is None
    assert not transport.closed.is_set()
    may_open.set()
    assert transport.closed.wait(5.0)  # nobody wants it any more


def test_a_router_that_comes_later_is_connected_to(monkeypatch: pytest.MonkeyPatch, said: list[str]) -> None:
    transport, attempts = FakeTransport(), count(1)
    transport.notice = "INSECURE"

    def third_time(*_: object, **__: object) -> FakeTransport:
        if next(attempts) < 3:
            raise NoRouterError("none")
        return transport

    async def run(timeout_s: float | None) -> object:
        settings = checked(SlaveSettings, ROUTED, "slave")
        return await opened(settings, "slave", RealRuntime(), False, timeout_s, obstacles(settings, "slave"))

    monkeypatch.setattr(session, "_ROUTER_S", 0.01)
    monkeypatch.setattr(ParallelTransport, "open", third_time)
    assert asyncio.run(run(None)) is transport
    assert said == ["slave: INSECURE"]
    attempts = count(-1000)
    with pytest.raises(NoRouterError) as caught:
        asyncio.run(run(0.1))
    assert str(caught.value).startswith(
        "no router within 0.1 s: 127.0.0.1:9 refuses the connection: start the router there (0."
    )


def test_what_else_is_wrong_with_the_network_ends_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    def taken(*_: object, **__: object) -> None:
        raise EndpointError("taken")

    async def run() -> None:
        settings = checked(SlaveSettings, {"transport": {"listen": ["tcp/127.0.0.1:9"]}}, "slave")
        await opened(settings, "slave", RealRuntime(), False, None, obstacles(settings, "slave"))

    monkeypatch.setattr(ParallelTransport, "open", taken)
    with pytest.raises(EndpointError, match="taken"):
        asyncio.run(run())
