"""The Zenoh transport keeps the contract of the memory bus, and what a network asks beyond it."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from forefeel.common.clock import MonotonicClock
from forefeel.common.topics import Qos
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.transport.zenoh_bus import ZenohTransport
from tests.live_cell import free_port
from tests.unit.bus_contract import KEY, OTHER, check_bus, put_until
from tests.waiting import PATIENCE_S, wait_until

faults: list[Exception] = []


@pytest.fixture
def open_session() -> Iterator[Callable[[], ZenohTransport]]:
    """Joins a session: the first listens, the others connect to it, and then to each other."""
    endpoints: list[str] = []
    faults.clear()
    with ExitStack() as stack:

        def join() -> ZenohTransport:
            own = f"tcp/127.0.0.1:{free_port()}"
            settings = TransportSettings(listen=(own,), connect=tuple(endpoints))
            endpoints.append(own)
            transport = ZenohTransport.open(settings, MonotonicClock(), faults.append)
            stack.callback(transport.close)
            return transport

        yield join


def test_zenoh_bus_keeps_contract_of_memory_bus(open_session: Callable[[], ZenohTransport]) -> None:
    check_bus(open_session)
    assert faults == []


def test_zenoh_bus_bad_handlers_and_keys_stop_no_delivery(open_session: Callable[[], ZenohTransport]) -> None:
    receiver, sender = open_session(), open_session()
    got: list[bytes] = []
    released = threading.Event()

    def fail_once(payload: bytes, _: int) -> None:
        got.append(payload)
        if len(got) == 1:
            raise RuntimeError("the handler failed")

    entered = threading.Event()

    def stand_still(*_: object) -> None:
        entered.set()
        released.wait(PATIENCE_S)

    receiver.subscribe(KEY, fail_once)
    receiver.subscribe(OTHER, stand_still)
    put = sender.publisher(KEY, Qos.EVENT)
    put_until(sender.publisher(OTHER, Qos.STREAM), entered.is_set)
    put_until(put, lambda: len(got) > 300)
    assert [str(fault) for fault in faults] == ["the handler failed"]
    for pattern in ("forefeel/**", "forefeel/*/*/slave/force", "forefeel/ce$*/insertion/**"):
        sender.publisher(pattern, Qos.EVENT)(b"pattern")
    put(bytes(300_000))
    put(bytes(60_000))
    wait_until(lambda: bytes(60_000) in got)
    assert set(got) == {b"probe", bytes(60_000)}
    released.set()
