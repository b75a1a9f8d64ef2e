"""Both daemons as coroutines in stepped time, over a bus in memory."""

import asyncio
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from forefeel import daemons
from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError, EndpointError, NoRouterError, RunError
from forefeel.common.state.folder import EVENTS
from forefeel.common.transport.memory import MemoryBus, MemoryTransport
from forefeel.common.transport.parallel import ParallelTransport
from forefeel.control_socket import ControlSocket
from forefeel.daemons import Process, SessionWatch
from forefeel.master.session import Session, SessionState
from forefeel.master.settings import MasterSettings
from forefeel.reachability import AnswerWatch, Obstacle
from forefeel.slave.devices import Devices
from forefeel.slave.settings import SlaveSettings
from tests.event_lines import Event, read_events
from tests.stepped import SteppedHost
from tests.unit.failing import refusing
from tests.unit.rigs import FakeGripper, FakeHandle, FakeLoadCell, FakeStage

S = 1_000_000_000
CONNECT: dict[str, Any] = {"transport": {"connect": ["tcp/127.0.0.1:9"]}}
ROUTED: dict[str, Any] = {"transport": {"mode": "client", "connect": ["tcp/127.0.0.1:9"]}}


class Bench:
    """A host in stepped time, a bus, and the settings of both daemons."""

    def __init__(self, folder: Path) -> None:
        self.host, self.network, self.folder = SteppedHost(), MemoryBus(), folder
        self.sessions: list[MemoryTransport] = []
        self.hint = ""
        self.open: Callable[[], ParallelTransport] = self.connect

    def settings(self, role: str, **more: Any) -> Any:  # noqa: ANN401 - of either daemon
        values = {"state": {"directory": str(self.folder / role)}, **more}
        return checked(SlaveSettings if role == "slave" else MasterSettings, values, role)

    def connect(self) -> ParallelTransport:
        session = self.network.session(self.host.clock)
        vars(session).update(notice="", hint=self.hint)
        self.sessions.append(session)
        return cast(ParallelTransport, session)

    def slave(self, duration_s: float | None = 1.0, **more: Any) -> Any:  # noqa: ANN401 - a coroutine
        return daemons.slave(self.settings("slave", **more), duration_s, False, self.host, self._opened)

    def master(self, duration_s: float | None = 1.0, **more: Any) -> Any:  # noqa: ANN401 - a coroutine
        return daemons.master(self.settings("master", **more), duration_s, False, self.host, self._opened)

    def _opened(self, *_: object, **__: object) -> ParallelTransport:
        return self.open()

    def log(self, role: str) -> list[Event]:
        return read_events(self.folder / role / EVENTS)

    def events(self, role: str) -> list[str]:
        return [each.event for each in self.log(role)]


@pytest.fixture(name="bench")
def made_bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_slave_alone_waits_and_ends_in_order(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    bench.host.run(bench.slave())
    first, last = capsys.readouterr().err.splitlines()
    assert "waiting for a master" in first and "stage at rest" in last
    assert bench.events("slave") == ["start", "stop"]
    assert [session.peers() for session in bench.sessions] == [0]
    assert not (bench.folder / "slave" / "control.sock").exists()


def test_pair_opens_session_and_moves(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    async def both() -> None:
        slave = asyncio.create_task(bench.slave(2.5))
        await asyncio.sleep(0.5)
        await bench.master(1.5)
        await slave

    bench.host.run(both())
    assert "session open" in capsys.readouterr().err
    transitions = [each.details["after"] for each in bench.log("slave") if each.event == "safety"]
    assert transitions[:3] == ["ready", "engaging", "armed"]
    assert bench.events("master")[-1] == "stop"


def test_fault_ends_the_daemon_with_its_cause(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("forefeel.slave.axis.SlaveAxis.beat", refusing(ZeroDivisionError("torn")))
    with pytest.raises(RunError, match="ZeroDivisionError: torn"):
        bench.host.run(bench.slave(None))
    events = bench.log("slave")
    assert any(each.details.get("after") == "fault" for each in events)
    assert events[-1].event == "stop" and "torn" in events[-1].details["reason"]


@pytest.mark.parametrize("name", ["serving", "ServiceManager"])
@pytest.mark.parametrize("role", ["slave", "master"])
def test_daemon_that_can_not_begin_closes_devices_and_transport(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, role: str, name: str
) -> None:
    closed = list[str]()
    stage, handle = FakeStage(), FakeHandle()
    monkeypatch.setattr(stage, "close", lambda: closed.append("slave"))
    monkeypatch.setattr(handle, "close", lambda: closed.append("master"))
    monkeypatch.setattr(
        "forefeel.slave.daemon._devices", lambda *_: Devices(stage, FakeGripper(), FakeLoadCell())
    )
    monkeypatch.setattr("forefeel.master.daemon.make_handle", lambda *_: handle)
    place: object = ControlSocket if name == "serving" else daemons
    monkeypatch.setattr(place, name, refusing(ConfigurationError("no socket")))
    with pytest.raises(ConfigurationError, match="no socket"):
        bench.host.run(bench.slave() if role == "slave" else bench.master())
    assert closed == [role]
    assert bench.sessions[0].peers() == 0
    assert bench.events(role)[-1] == "stop"


# --- coming to the network ---


def test_router_that_comes_later_is_connected_to(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    attempts = count(1)

    def third_time() -> ParallelTransport:
        if next(attempts) < 3:
            raise NoRouterError("none")
        return bench.connect()

    bench.open = third_time
    bench.host.run(bench.slave(**ROUTED))
    assert "waiting for a master" in capsys.readouterr().err


def test_slave_at_a_router_is_told_the_mode(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    bench.hint = "a router answers there"
    bench.host.run(bench.slave(6.0, **CONNECT))
    assert "waiting for a connection: a router answers there" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "role"), [(NoRouterError("none"), "slave"), (EndpointError("taken"), "master")]
)
def test_network_that_can_not_be_used_ends_the_wait(bench: Bench, error: Exception, role: str) -> None:
    bench.open = cast(Callable[[], ParallelTransport], refusing(error))
    with pytest.raises(type(error)):
        bench.host.run(bench.slave(**ROUTED) if role == "slave" else bench.master())
    assert bench.events(role) == ["start", "stop"]


def test_master_without_slave_names_the_cause(bench: Bench) -> None:
    with pytest.raises(EndpointError, match=r"127\.0\.0\.1:9 refuses the connection"):
        bench.host.run(bench.master(**CONNECT, peer_timeout_s=1.0))


# --- a master's sessions ---


class Waiting:
    """A master of one axis that waits for its slave; `obstacles` names what is in the way."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - of YAML
        self.said: list[str] = []
        self.session = Session(count(11).__next__)
        self.transport = SimpleNamespace(count=0, hint="")
        self.transport.peers = lambda: self.transport.count
        self.probes = 0
        host = SteppedHost()
        process = SimpleNamespace(
            say=self.said.append,
            runtime=None,
            answer_watch=lambda _, silence: AnswerWatch(self.find, silence, self.said.append, host),
        )
        axis: Any = SimpleNamespace(name="insertion", session=self.session)
        self.watch = SessionWatch(
            [axis],
            checked(MasterSettings, CONNECT | settings, "master"),
            cast(ParallelTransport, self.transport),
            cast(Process, process),
        )

    def find(self) -> list[Obstacle]:
        self.probes += 1
        return [Obstacle("10.0.0.2:7447 refuses the connection", "start the slave there")]

    def wait(self, from_s: int, until_s: int) -> None:
        for now_s in range(from_s, until_s):
            self.session.should_ask(now_s * S)
            self.watch.look(now_s * S)

    def answer(self, accepted: bool, now_s: int, reason: str = "") -> None:
        self.session.answered(self.session.session_id, accepted, reason, now_s * S, now_s * S)


def refused(waiting: Waiting) -> None:
    for now_s in range(8):
        waiting.answer(False, now_s, "another session holds the lease")
        waiting.wait(now_s, now_s + 1)


def connected(waiting: Waiting, hint: str = "") -> None:
    waiting.transport.count, waiting.transport.hint = 1, hint
    waiting.wait(0, 8)


@pytest.mark.parametrize(
    ("act", "listens", "words", "probes"),
    [
        (lambda waiting: waiting.wait(0, 8), False, "refuses the connection", 1),
        (connected, False, "no slave of cell cell, axis insertion", 0),
        (connected, True, "refuses the connection", 1),
        (lambda waiting: connected(waiting, "a router answers there"), False, "a router answers there", 0),
        (refused, False, "another session holds the lease", 0),
    ],
    ids=["nothing", "connected", "connected to us", "router", "refused"],
)
def test_waiting_master_names_the_cause(
    act: Callable[[Waiting], None], listens: bool, words: str, probes: int
) -> None:
    endpoints = {**CONNECT["transport"], **({"listen": ["tcp/127.0.0.1:8"]} if listens else {})}
    waiting = Waiting(transport=endpoints)
    act(waiting)
    assert len(waiting.said) == 1 and words in waiting.said[0]
    assert waiting.probes == probes
    if probes:
        assert words in waiting.session.cause(8 * S)


def test_lost_session_is_reported_until_it_is_open_again() -> None:
    waiting = Waiting()
    waiting.answer(True, 0)
    assert waiting.watch.look(0)
    waiting.wait(2, 9)
    lost, cause = waiting.said
    assert "no state from the slave" in lost and "refuses the connection" in cause
    waiting.answer(True, 9)
    assert waiting.watch.look(9 * S)
    assert waiting.said[2:] == ["session open again"]
    assert waiting.session.state is SessionState.OPEN


def test_differing_settings_end_the_wait() -> None:
    waiting = Waiting()
    waiting.session.should_ask(0)
    waiting.answer(False, 0, "settings differ: kind: insertion here, rotation there")
    with pytest.raises(ConfigurationError, match="settings differ"):
        waiting.watch.look(0)
    assert waiting.said == []
