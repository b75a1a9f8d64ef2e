"""What strangers can hold of a process that listens."""

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.runtime.descriptors import DESCRIPTORS
from forefeel.common.transport.pending import MOST, MOST_SILENT, SILENT_S, PendingConnections
from forefeel.common.transport.settings import TransportSettings

_TIMEOUT_S = 5.0
_SOON_S = 0.1


class Listener:
    """A port at which strangers connect; the test accepts them as Zenoh would."""

    def __init__(self, family: socket.AddressFamily = socket.AF_INET) -> None:
        self._stack = ExitStack()
        host = "127.0.0.1" if family is socket.AF_INET else "::"
        dual = family is socket.AF_INET6
        self._socket = self._stack.enter_context(
            socket.create_server((host, 0), family=family, backlog=256, dualstack_ipv6=dual)
        )
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self.clock, self.links = VirtualClock(), list[str]()
        self.faults: list[Exception] = []
        settings = TransportSettings(listen=(f"tls/0.0.0.0:{self.port}",), open_timeout_s=_TIMEOUT_S)
        self.pending = PendingConnections(settings, lambda: self.links, self.clock, self.faults.append)

    def connect(self, count: int, says: bytes = b"") -> list[socket.socket]:
        """Strangers; what they say has arrived."""
        DESCRIPTORS.allow_all()  # they are other processes
        found = [
            self._stack.enter_context(socket.create_connection(("127.0.0.1", self.port)))
            for _ in range(count)
        ]
        for each in found:
            each.sendall(says)
            each.settimeout(5.0)
        return found

    def accept(self) -> int:
        """All that wait; how many."""
        count = 0
        while True:
            try:
                self._stack.enter_context(self._socket.accept()[0])
            except BlockingIOError:
                return count
            count += 1

    def wait(self, duration_s: float) -> None:
        self.clock.set_ns(self.clock.now_ns() + int(duration_s * 1e9))

    def close(self) -> None:
        self._stack.close()
        DESCRIPTORS.allow_all()


@pytest.fixture(params=[socket.AF_INET, socket.AF_INET6], ids=["IPv4", "both"])
def listener(request: pytest.FixtureRequest) -> Iterator[Listener]:
    listening = Listener(request.param)
    yield listening
    listening.close()
    assert listening.faults == []


def is_closed(connection: socket.socket) -> bool:
    """Whether the other end has ended it; what is to be so has come by then."""
    connection.settimeout(_SOON_S)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionResetError:
        return True


def test_who_says_nothing_is_closed_and_who_speaks_may_take_longer(listener: Listener) -> None:
    silent, speaking = listener.connect(1)[0], listener.connect(1, b"hello")[0]
    listener.accept()
    listener.pending.look()
    listener.wait(0.9 * SILENT_S)
    listener.pending.look()
    assert not is_closed(silent)
    listener.wait(0.2 * SILENT_S)
    listener.pending.look()
    assert is_closed(silent)
    assert not is_closed(speaking)
    listener.wait(_TIMEOUT_S)
    listener.pending.look()
    assert is_closed(speaking)
    assert listener.pending.closed == 2


def test_a_connection_of_which_a_session_has_come_stays(listener: Listener) -> None:
    session = listener.connect(1)[0]
    listener.accept()
    listener.links.append(f"tls/127.0.0.1:{session.getsockname()[1]}")
    for _ in range(3):
        listener.pending.look()
        listener.wait(2 * _TIMEOUT_S)
    assert not is_closed(session)


def test_of_too_many_the_oldest_silent_ones_go_first(listener: Listener) -> None:
    speaking = listener.connect(10, b"hello")
    oldest = listener.connect(10)
    listener.accept()
    listener.pending.look()
    listener.wait(1.0)
    newest = listener.connect(MOST - 10)
    listener.accept()
    listener.pending.look()
    assert all(is_closed(each) for each in oldest)
    assert not any(is_closed(each) for each in (*speaking[:3], *newest[:3]))


def test_with_enough_silent_ones_the_queue_is_emptied_and_no_descriptor_is_left_to_accept_more(
    listener: Listener,
) -> None:
    listener.connect(MOST_SILENT)
    listener.accept()
    waiting = listener.connect(40)
    assert listener.pending.look()
    assert all(is_closed(each) for each in waiting)
    with pytest.raises(OSError) as error:
        os.close(os.dup(0))
    assert error.value.errno == errno.EMFILE
    assert listener.pending.look()  # nobody waits any more
    os.close(os.dup(0))
    assert listener.accept() == 0


def opened_until_refused() -> int:
    """How many descriptors can be opened; they are closed again."""
    with ExitStack() as opened, pytest.raises(OSError, match="Too many open files"):
        for count in range(1000):  # noqa: B007 - it is the result
            opened.callback(os.close, os.dup(0))
    return count


def test_the_reserve_opens_files_where_all_others_are_taken() -> None:
    try:
        DESCRIPTORS.allow(0, DESCRIPTORS.used())
        with pytest.raises(OSError, match="Too many open files"):
            os.dup(0)
        with DESCRIPTORS.reserve():
            os.close(os.dup(0))
            with DESCRIPTORS.reserve(1):
                os.close(os.dup(0))
            os.close(os.dup(0))
        with pytest.raises(OSError, match="Too many open files"):
            os.dup(0)
        DESCRIPTORS.allow(3, DESCRIPTORS.used())
        assert 1 <= opened_until_refused() <= 3
    finally:
        DESCRIPTORS.allow_all()
    os.close(os.dup(0))
