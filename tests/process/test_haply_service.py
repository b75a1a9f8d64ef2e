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
from forefeel.devices.haply.driver import HaplyHandle
from forefeel.devices.haply.settings import HaplySettings
from tests.emulators.haply_service import HaplyService
from tests.waiting import wait_until


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
    settings = {"driver": "haply", "url": f"ws://127.0.0.1:{port}", "watchdog_s": 0.1}
    return HaplyHandle(checked(HaplySettings, settings, "test"))


def test_it_exchanges_states_and_forces_and_a_service_that_ends_is_a_fault() -> None:
    service, clock = HaplyService(), MonotonicClock()
    service.position_m = [0.0, 0.03, 0.0]
    with running(service) as server:
        handle = handle_on(server.socket.getsockname()[1])
        handle.open()
        try:
            states = handle.counters["states"]
            wait_until(lambda: handle.counters["states"] > states + 20)
            if handle.link.inhibited is None:  # a machine that stands still for 0.1 s is a fault, too
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
