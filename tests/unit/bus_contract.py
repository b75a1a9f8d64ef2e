"""What every transport keeps to, be it within one process or over a network."""

from collections.abc import Callable
from itertools import pairwise

from forefeel.common.clock import MonotonicClock
from forefeel.common.topics import FORCE, SLAVE_STATE, Qos
from forefeel.common.transport.port import MOST_POLLED, Put, Transport
from tests.waiting import wait_until

KEY, OTHER = FORCE.key("cell", "insertion"), SLAVE_STATE.key("cell", "insertion")
POLLED = FORCE.taken_key("cell", "insertion")


def put_until(put: Put, condition: Callable[[], object], payload: bytes = b"probe") -> None:
    """Repeats a payload, as every stream does, until it got through: declarations travel, too."""

    def attempt() -> object:
        put(payload)
        return condition()

    wait_until(attempt)


def check_bus(open_session: Callable[[], Transport]) -> None:
    """Raises AssertionError. `open_session`: joins a new session to those that there are."""
    clock = MonotonicClock()
    receiver, sender = open_session(), open_session()
    got: list[tuple[bytes, int]] = []
    own: list[bytes] = []
    receiver.subscribe(KEY, lambda payload, stamp_ns: got.append((payload, stamp_ns)))
    sender.subscribe(KEY, lambda payload, _: own.append(payload))
    put = sender.publisher(KEY, Qos.EVENT)
    put_until(put, lambda: got)
    before_ns = clock.now_ns()
    for last in range(9, 200, 10):  # ten at a time: a burst that no thread takes away in time may be dropped
        for number in range(last - 9, last + 1):
            put(b"%d" % number)
        wait_until(lambda: got[-1][0] == b"%d" % last)  # noqa: B023
    numbers = [(int(payload), stamp_ns) for payload, stamp_ns in got if payload != b"probe"]
    assert [number for number, _ in numbers] == list(range(200))
    assert all(before_ns <= a <= b <= clock.now_ns() for (_, a), (_, b) in pairwise(numbers))
    assert own == []
    assert (receiver.peers(), sender.peers()) == (1, 1)
    _check_keys(receiver, sender)
    _check_poll(receiver, sender)
    late = open_session()
    heard: list[bytes] = []
    late.subscribe(KEY, lambda payload, _: heard.append(payload))
    put_until(put, lambda: heard)
    for _ in range(2):
        receiver.close()
    seen, heard_before = len(got), len(heard)
    put_until(put, lambda: len(heard) > heard_before)
    assert len(got) == seen
    assert receiver.peers() == 0
    sender.close()
    put(b"from a closed session")
    assert own == []


def _check_keys(receiver: Transport, sender: Transport) -> None:
    """Each quality of service reaches who subscribes to all keys below a prefix, and nothing else does."""
    got: set[tuple[str, bytes]] = set()
    receiver.subscribe_all("forefeel/cell", lambda key, payload, _: got.add((key, payload)))
    sender.publisher("forefeel/other/insertion/slave/force", Qos.STREAM)(b"elsewhere")
    for qos in Qos:
        for key in (KEY, OTHER):
            payload = f"{qos.name} {key}".encode()
            put_until(sender.publisher(key, qos), lambda: (key, payload) in got, payload)  # noqa: B023
    assert {key for key, _ in got} == {KEY, OTHER}
    assert len(got) == 2 * len(Qos)


def _check_poll(receiver: Transport, sender: Transport) -> None:
    """Of a backlog a bounded part at each poll, oldest first, and nothing between two polls."""
    got: list[bytes] = []
    sizes = [0]
    poll = receiver.polled(POLLED, lambda payload, _: got.append(payload))
    put = sender.publisher(POLLED, Qos.EVENT)

    def has(count: int) -> bool:
        assert len(got) == sizes[-1]
        poll()
        sizes.append(len(got))
        return len(got) >= count

    put_until(put, lambda: has(1))
    backlog = [b"%d" % number for number in range(2 * MOST_POLLED)]
    for payload in backlog:
        put(payload)
    wait_until(lambda: any(has(1 + len(backlog)) and got[-1] == backlog[-1] for _ in range(4)))
    assert [payload for payload in got if payload != b"probe"] == backlog
    assert max(after - before for before, after in pairwise(sizes)) <= MOST_POLLED
