"""The Inverse3's driver on a WebSocket of a mock of its service: real time, a real socket."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import Server, ServerConnection, serve

from forefeel.common.clock import MonotonicClock
from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError
from forefeel.devices.haply import driver
from forefeel.devices.haply.driver import HaplyHandle
from forefeel.devices.haply.settings import HaplySettings
from tests.emulators.haply_service import HaplyService
from tests.waiting import PATIENCE_S, wait_until


@contextmanager
def running(service: HaplyService) -> Iterator[Server]:
    def talk(socket: ServerConnection) -> None:
        socket.send(service.greeting())
        try:
            for text in socket:
                for answer in service.answer(str(text)):
                    socket.send(answer)
        except ConnectionClosed:
            return

    with serve(talk, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def handle_on(port: int) -> HaplyHandle:
    """A handle with a watchdog that a busy machine does not trip, longer than settings allow."""
    settings = checked(HaplySettings, {"driver": "haply", "url": f"ws://127.0.0.1:{port}"}, "test")
    return HaplyHandle(settings.model_copy(update={"watchdog_s": PATIENCE_S}))


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_CONNECT_S", "_OPEN_S"):
        monkeypatch.setattr(driver, name, PATIENCE_S)
    monkeypatch.setattr(driver, "_PATIENCE_NS", round(PATIENCE_S * 1e9))


def test_it_exchanges_states_and_forces_and_a_service_that_ends_is_a_fault() -> None:
    service, clock = HaplyService(), MonotonicClock()
    service.position_m = [0.0, 0.03, 0.0]
    with running(service) as server:
        handle = handle_on(server.socket.getsockname()[1])
        handle.open()
        try:
            states = handle.counters["states"]
            wait_until(lambda: handle.counters["states"] > states + 20)
            assert handle.read(clock.now_ns()).position_m == pytest.approx(0.03)
            server.shutdown()
            wait_until(lambda: handle.link.inhibited is not None)
            with pytest.raises(DeviceError):
                handle.render(1.0, clock.now_ns())
        finally:
            handle.close()
    assert service.force_n == [0.0, 0.0, 0.0]


def test_nobody_there_and_no_websockets_are_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with running(HaplyService()) as server:
        port = server.socket.getsockname()[1]
    with pytest.raises(DeviceSetupError, match="expected Haply's service to run there") as refused:
        handle_on(port).open()
    assert "\n" not in str(refused.value)
    monkeypatch.setitem(sys.modules, "websockets.sync.client", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'forefeel\[haply\]'"):
        handle_on(port).open()
