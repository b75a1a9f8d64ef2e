"""Running a daemon: whatever keeps it from its work, devices and transport are closed behind it."""

import asyncio
from contextlib import nullcontext

import pytest

from forefeel import daemons
from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import ConfigurationError
from forefeel.common.runtime.real import RealRuntime
from forefeel.common.transport.memory import MemoryBus, MemoryTransport
from forefeel.local.server import LocalServer
from forefeel.master.settings import MasterSettings
from forefeel.slave.devices import Devices
from forefeel.slave.settings import SlaveSettings
from tests.unit.failing import refusing
from tests.unit.master_rig import FakeHandle
from tests.unit.real_time import as_it_is
from tests.unit.slave_rig import FakeGripper, FakeLoadCell, FakeStage

process_as_it_is = pytest.fixture(as_it_is, autouse=True, name="process_as_it_is")


@pytest.fixture(name="session", autouse=True)
def with_session(monkeypatch: pytest.MonkeyPatch) -> MemoryTransport:
    """The daemon's transport, one of two on a bus. Its process keeps its scheduling and its signals."""
    network, clock = MemoryBus(), MonotonicClock()
    session = network.session(clock)
    network.session(clock)

    async def opened(*_: object) -> MemoryTransport:
        return session

    monkeypatch.setattr(daemons, "opened", opened)
    monkeypatch.setattr(daemons, "_runtime", lambda _: nullcontext((RealRuntime(), None)))
    return session


FAILURES: list[tuple[object, str]] = [(LocalServer, "serving"), (daemons, "warn_of_latency")]
"""What fails while the loop runs, and before it does."""


@pytest.mark.parametrize(("place", "name"), FAILURES, ids=["socket", "before"])
def test_a_slave_that_can_not_begin_closes_its_devices_and_its_transport(
    session: MemoryTransport, monkeypatch: pytest.MonkeyPatch, place: object, name: str
) -> None:
    stage, opened = FakeStage(), list[bool]()
    monkeypatch.setattr(
        "forefeel.slave.daemon._devices", lambda *_: Devices(stage, FakeGripper(), FakeLoadCell())
    )

    def refuse(*_: object) -> None:
        opened.append(stage.opened)
        raise ConfigurationError("no socket")

    monkeypatch.setattr(place, name, refuse)
    with pytest.raises(ConfigurationError, match="no socket"):
        asyncio.run(daemons._slave(SlaveSettings(), None, insecure=False))
    assert opened == [True]
    assert not stage.opened
    assert session.peers() == 0


@pytest.mark.parametrize(("place", "name"), FAILURES, ids=["socket", "before"])
def test_a_master_that_can_not_begin_closes_its_handle_and_its_transport(
    session: MemoryTransport, monkeypatch: pytest.MonkeyPatch, place: object, name: str
) -> None:
    handle, closed = FakeHandle(), list[bool]()
    monkeypatch.setattr(handle, "close", lambda: closed.append(True))
    monkeypatch.setattr("forefeel.master.daemon.make_handle", lambda *_: handle)
    monkeypatch.setattr("forefeel.master.daemon.compile_kernels", lambda: None)
    monkeypatch.setattr("forefeel.common.estimation.forecast.compile_kernels", lambda: None)
    monkeypatch.setattr(place, name, refusing(ConfigurationError("no socket")))
    with pytest.raises(ConfigurationError, match="no socket"):
        asyncio.run(daemons._master(MasterSettings(), None, insecure=False))
    assert closed == [True]
    assert session.peers() == 0
