import pytest

from forefeel.common.clock import MonotonicClock, VirtualClock
from forefeel.common.topics import Qos
from forefeel.common.transport.memory import MemoryBus
from tests.unit.bus_contract import check_bus


def test_memory_bus_keeps_contract() -> None:
    bus = MemoryBus()
    check_bus(lambda: bus.session(MonotonicClock()))


def test_memory_bus_stamps_with_clock_of_receiver() -> None:
    bus = MemoryBus()
    got: list[tuple[str, bytes, int]] = []
    bus.session(VirtualClock(7)).subscribe_all("cell/axis", lambda *sample: got.append(sample))
    sender = bus.session(VirtualClock(5))
    for key in ("cell/axis", "cell/axis/force", "cell/axis2/force", "cell"):
        sender.publisher(key, Qos.EVENT)(key.encode())
    assert got == [(key, key.encode(), 7) for key in ("cell/axis", "cell/axis/force")]


def test_an_exception_of_a_handler_stops_the_run() -> None:
    bus = MemoryBus()
    sender, receiver = bus.session(VirtualClock()), bus.session(VirtualClock())

    def refuse(payload: bytes, _: int) -> None:
        raise ValueError(payload.decode())

    receiver.subscribe("a", refuse)
    with pytest.raises(ValueError, match="refused"):
        sender.publisher("a", Qos.STREAM)(b"refused")
