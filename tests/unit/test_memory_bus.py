import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.topics import Qos
from forefeel.common.transport.memory import MemoryBus


def test_delivers_to_other_sessions_only_with_the_stamp_of_the_receiver() -> None:
    bus = MemoryBus()
    sender, receiver = bus.session(VirtualClock(5)), bus.session(VirtualClock(7))
    got: list[tuple[str, bytes, int]] = []
    sender.subscribe("a", lambda payload, stamp: got.append(("own", payload, stamp)))
    receiver.subscribe("a", lambda payload, stamp: got.append(("other", payload, stamp)))
    put = sender.publisher("a", Qos.STREAM)
    put(b"1")
    put(b"2")
    assert got == [("other", b"1", 7), ("other", b"2", 7)]


def test_a_subscriber_that_comes_after_the_publisher_hears_it() -> None:
    bus = MemoryBus()
    put = bus.session(VirtualClock()).publisher("a", Qos.STATE)
    put(b"nobody listens")
    got: list[bytes] = []
    bus.session(VirtualClock()).subscribe("a", lambda payload, _: got.append(payload))
    put(b"now")
    assert got == [b"now"]


def test_subscribe_all_hears_the_prefix_and_what_is_below_it() -> None:
    bus = MemoryBus()
    sender, recorder = bus.session(VirtualClock()), bus.session(VirtualClock(3))
    got: list[tuple[str, bytes, int]] = []
    recorder.subscribe_all("cell/axis", lambda *sample: got.append(sample))
    for key in ("cell/axis", "cell/axis/force", "cell/axis/slave/state", "cell/axis2/force", "cell"):
        sender.publisher(key, Qos.EVENT)(key.encode())
    assert got == [
        (key, key.encode(), 3) for key in ("cell/axis", "cell/axis/force", "cell/axis/slave/state")
    ]


def test_nothing_is_delivered_after_close_of_either_end() -> None:
    bus = MemoryBus()
    sender, receiver, third = (bus.session(VirtualClock()) for _ in range(3))
    got: list[str] = []
    receiver.subscribe("a", lambda *_: got.append("receiver"))
    third.subscribe("a", lambda *_: got.append("third"))
    put = sender.publisher("a", Qos.STREAM)
    assert (sender.peers(), receiver.peers()) == (2, 2)
    receiver.close()
    receiver.close()
    put(b"")
    assert got == ["third"]
    assert (sender.peers(), receiver.peers()) == (1, 0)
    sender.close()
    put(b"")
    assert got == ["third"]


def test_a_session_closed_by_a_handler_hears_nothing_more_of_the_same_payload() -> None:
    bus = MemoryBus()
    sender, closing, closed = (bus.session(VirtualClock()) for _ in range(3))
    got: list[bytes] = []
    closing.subscribe("a", lambda *_: closed.close())
    closed.subscribe("a", lambda payload, _: got.append(payload))
    sender.publisher("a", Qos.STREAM)(b"x")
    assert got == []


def test_an_exception_of_a_handler_stops_the_run() -> None:
    bus = MemoryBus()
    sender, receiver = bus.session(VirtualClock()), bus.session(VirtualClock())

    def refuse(payload: bytes, _: int) -> None:
        raise ValueError(payload.decode())

    receiver.subscribe("a", refuse)
    with pytest.raises(ValueError, match="refused"):
        sender.publisher("a", Qos.STREAM)(b"refused")
